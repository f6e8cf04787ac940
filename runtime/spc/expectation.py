"""Expected readings, as `plan-expect` writes them, and a control chart that compares readings with them.

The expected readings are histograms of several worlds. The first world is the planned one; each other world
differs from it, for example in the friction. The likelihood ratio of a part is the probability of its
readings in another world, divided by their probability in the planned world. The chart's statistic is a sum
over all parts at which the cell may have changed; each term is the product of the ratios from that part on
(Shiryaev 1963, Roberts 1966).

On an unchanged cell the mean of the statistic grows by at most 1 with each part. So the mean number of parts
until a false alarm is at least the limit (Pollak, Annals of Statistics 15, 1987). This bound assumes that the
shares in the histograms are exact, although they are counted in trials, and that a reading depends on earlier
readings only through its node.
"""

from dataclasses import dataclass, field
from math import exp, log
from pathlib import Path
from typing import Any

from runtime.shell import strict_json
from runtime.shell.errors import InputError, UsageError
from runtime.spc.history import History, Part
from runtime.table import Table

KIND, VERSION = "expected readings", 2
# readings that are added to the counted readings of each node, evenly spread over all bins
PRIOR = 20.0
MOST_BINS = 1000  # most bins of a node's histogram; tables have fewer
LIMIT = 1.5e4  # mean number of parts to a false alarm of this chart alone
CLIP = log(200.0)  # largest log-likelihood ratio of one part: a single outlier is no drift

Shares = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Expectation:
    """Predicted histograms of the readings at each node in several worlds, the planned world first."""

    table_sha256: str  # digest of the table's file
    names: tuple[str, ...]  # names of the worlds
    shares: tuple[Shares, ...]  # for each world, shares of shape (nodes, bins), none of them zero

    def check(self, history: History) -> None:
        """Checks that the expectation belongs to the table of a history.

        Raises:
            UsageError: the expectation belongs to another table.
        """
        table, planned = history.table, self.shares[0]
        alike = len(planned) == len(table.nodes) and len(planned[0]) == table.gripper.bins
        if history.table_sha256 not in ("", self.table_sha256) or not alike:
            raise UsageError(
                "--expected is of another table than the journals; make it with plan-expect from theirs"
            )

    def gains(self, table: Table, part: Part) -> list[float]:
        """Log-likelihood ratios of a part's readings, one for each world but the planned world.

        Each ratio compares the readings' probability in a world with their probability in the planned world.
        A logarithm above `CLIP` is cut to `CLIP`.
        """
        places = [(each.node, table.gripper.bin_of(each.width_um)) for each in part.squeezes]
        planned, *others = (sum(log(shares[n][c]) for n, c in places) for shares in self.shares)
        # On an unchanged cell the likelihood ratio has a mean of at most 1; cutting does not raise the mean.
        return [min(other - planned, CLIP) for other in others]


@dataclass(slots=True)
class ShiryaevRoberts:
    """Control chart of readings: alarms when the readings fit another world better than the planned world.

    The chart's value is the Shiryaev-Roberts statistic, averaged over all worlds but the planned world.
    """

    expected: Expectation
    sums: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.sums = [0.0] * (len(self.expected.names) - 1)

    @property
    def value(self) -> float:
        """The average statistic; the chart alarms when this value reaches `LIMIT`."""
        return sum(self.sums) / len(self.sums)

    def add(self, table: Table, part: Part) -> str | None:
        """Adds one part; on an alarm, restarts the chart.

        Returns:
            On an alarm, the name of the world that fits the readings best; None without an alarm.
        """
        gains = self.expected.gains(table, part)
        pairs = zip(self.sums, gains, strict=True)
        self.sums = [(1.0 + total) * exp(gain) for total, gain in pairs]
        if self.value < LIMIT:
            return None
        likeliest = max(range(len(self.sums)), key=lambda k: self.sums[k])
        self.sums = [0.0] * len(self.sums)
        return self.expected.names[1 + likeliest]


def load(path: Path) -> Expectation:
    """Reads expected readings from a file that `plan-expect` has written.

    Raises:
        InputError: the file cannot be read, or is no output of `plan-expect`.
    """

    def refused(problem: str) -> InputError:
        return InputError(f"--expected {path}: {problem}; make it with plan-expect")

    record = strict_json.load(path, refused)
    try:
        return _checked(record)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise refused(f"does not hold {KIND} of version {VERSION}") from error


def _checked(record: dict[str, Any]) -> Expectation:
    worlds = record["worlds"]
    names = tuple(str(world["name"]) for world in worlds)
    bins = int(record["bins"])
    shares = tuple(tuple(_shares(node, bins) for node in world["readings"]) for world in worlds)
    alike = len(names) > 1 and len({len(nodes) for nodes in shares}) == 1
    if (record["kind"], record["version"]) != (KIND, VERSION) or not alike:
        raise ValueError(record["kind"])
    return Expectation(str(record["table_sha256"]), names, shares)


def _shares(node: dict[str, int], bins: int) -> tuple[float, ...]:
    if bins > MOST_BINS:
        raise ValueError(bins)
    filled = [0.0] * bins
    for number, times in node.items():
        if not (0 <= int(number) < bins and times >= 0):
            raise ValueError(number)
        filled[int(number)] = float(times)
    total = sum(filled) + PRIOR
    return tuple((times + PRIOR / bins) / total for times in filled)
