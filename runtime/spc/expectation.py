"""Expected readings by `plan-expect`, and likelihood ratios of readings in other worlds.

A part's likelihood ratio compares its readings in another world, such as one of another friction, with the
planned world. The statistic is a sum over all parts at which the change may have begun; each term is the
product of the ratios since then (Shiryaev 1963, Roberts 1966). On a healthy cell its mean grows by at most
one a part, so the mean number of parts to a false alarm is at least the limit (Pollak, Annals of Statistics
15, 1987). This bound assumes that the shares are exact, and that a reading depends on earlier ones only
through its node; the shares are counted in trials.
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
# prior readings of each node, evenly spread over all bins
PRIOR = 20.0
MOST_BINS = 1000  # most bins of a node's readings; tables have fewer
LIMIT = 1.5e4  # mean number of parts to a false alarm of this chart alone
CLIP = log(200.0)  # largest contribution of one part: a single outlier is no drift

Shares = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class Expectation:
    """Predicted histograms of each node's readings in several worlds; the planned world is the first."""

    table_sha256: str  # digest of the table's file
    names: tuple[str, ...]  # names of the worlds
    shares: tuple[Shares, ...]  # (nodes, bins) for each world, none of them zero

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
        """Log-likelihood ratios of a part's readings: each other world to the planned one, at most `CLIP`."""
        places = [(each.node, table.gripper.bin_of(each.width_um)) for each in part.squeezes]
        planned, *others = (sum(log(shares[n][c]) for n, c in places) for shares in self.shares)
        # A clipped ratio, like the ratio itself, has a mean of at most one.
        return [min(other - planned, CLIP) for other in others]


@dataclass(slots=True)
class ShiryaevRoberts:
    """Control chart of readings: mean Shiryaev-Roberts statistic of all worlds but the planned one."""

    expected: Expectation
    sums: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.sums = [0.0] * (len(self.expected.names) - 1)

    @property
    def value(self) -> float:
        """The mean statistic; the chart alarms when it reaches `LIMIT`."""
        return sum(self.sums) / len(self.sums)

    def add(self, table: Table, part: Part) -> str | None:
        """Adds one part; on an alarm, restarts the chart.

        Returns:
            On an alarm the name of the most likely of the other worlds, else None.
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
    """Reads the output of `plan-expect`.

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
