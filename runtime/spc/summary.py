"""The figures of a report: success against the table's prediction, residuals by leaf, fit of the branches."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

from runtime.spc.charts import chi_square
from runtime.spc.distributions import chi_square_tail, wilson
from runtime.spc.expectation import Expectation
from runtime.spc.history import History, Part
from runtime.spc.monitor import Alarm, branch_counts, branch_shares, watch
from runtime.table import PPM

PREDICTED_FROM = 6000  # trials behind a share that a table does not say the number for


class Moments(NamedTuple):
    """Mean and standard deviation of a sample; the latter 0 for fewer than two values."""

    mean: float
    sigma: float


class LeafRow(NamedTuple):
    """The parts of one leaf.

    Attributes:
        leaf: its index.
        parts: that ended there.
        judged: of these, judged to pass or fail.
        passed: of these.
        predicted: success rate that the table predicts, None where no trial ended there.
        residuals: of x [mm], y [mm] and theta [rad]; empty where none was measured.
    """

    leaf: int
    parts: int
    judged: int
    passed: int
    predicted: float | None
    residuals: tuple[Moments, ...]


class NodeRow(NamedTuple):
    """The squeezes at one node.

    Attributes:
        node: its index.
        counts: of each branch, and last of its rejects.
        shares: predicted.
        statistic: chi-square.
        freedom: its degrees of freedom.
        tail: probability of a larger one where the table is right.
    """

    node: int
    counts: tuple[int, ...]
    shares: tuple[float, ...]
    statistic: float
    freedom: int
    tail: float


@dataclass(frozen=True, slots=True)
class Summary:
    """All figures.

    Attributes:
        outcomes: how many parts ended how.
        verdicts: how many audits said what.
        passed: judged parts that passed.
        judged: parts judged to pass or fail.
        interval: 95 % interval of the success rate.
        predicted: what the table's evaluation says.
        agrees: whether the interval holds the predicted rate.
        leaves: by leaf.
        nodes: by node.
        tail: of the chi-square over all nodes.
        alarms: of the charts.
    """

    outcomes: dict[str, int]
    verdicts: dict[str, int]
    passed: int
    judged: int
    interval: tuple[float, float]
    predicted: float
    agrees: bool
    leaves: tuple[LeafRow, ...]
    nodes: tuple[NodeRow, ...]
    tail: float
    alarms: tuple[Alarm, ...]

    def fields(self) -> dict[str, object]:
        """The summary as JSON holds it."""
        return {
            "parts": sum(self.outcomes.values()),
            "outcomes": self.outcomes,
            "verdicts": self.verdicts,
            "judged": self.judged,
            "success_rate": self.passed / self.judged if self.judged else None,
            "success_ci95": list(self.interval),
            "success_predicted": self.predicted,
            "agrees": self.agrees,
            "branches_p": self.tail,
            "alarms": [alarm._asdict() for alarm in self.alarms],
        }


def summarise(history: History, expected: Expectation | None = None) -> Summary:
    """The figures of a history; of its readings too where it is known what to expect of them.

    Raises:
        ArgumentsError: the expectation is of another table.
    """
    parts, table = history.parts, history.table
    passed = sum(part.verdict == "pass" for part in parts)
    judged = passed + sum(part.verdict == "fail" for part in parts)
    interval, predicted = wilson(passed, judged), table.predicted.success_ppm / PPM
    nodes = tuple(_nodes(history))
    statistic, freedom = sum(row.statistic for row in nodes), sum(row.freedom for row in nodes)
    return Summary(
        _counted(part.outcome or "broken off" for part in parts),
        _counted(part.verdict for part in parts if part.verdict is not None),
        passed,
        judged,
        interval,
        predicted,
        interval[0] <= predicted <= interval[1],
        tuple(_leaves(history)),
        nodes,
        chi_square_tail(statistic, freedom),
        tuple(watch(history, expected)),
    )


def moments(values: Sequence[float]) -> Moments:
    """Mean and standard deviation."""
    mean = sum(values) / len(values)
    spread = sum((value - mean) ** 2 for value in values)
    return Moments(mean, sqrt(spread / (len(values) - 1)) if len(values) > 1 else 0.0)


def _counted(names: Iterable[str]) -> dict[str, int]:
    found: dict[str, int] = {}
    for name in names:
        found[name] = found.get(name, 0) + 1
    return dict(sorted(found.items()))


def _leaves(history: History) -> Iterable[LeafRow]:
    by_leaf: dict[int, list[Part]] = {}
    for part in history.parts:
        if part.leaf is not None:
            by_leaf.setdefault(part.leaf, []).append(part)
    for leaf, parts in sorted(by_leaf.items()):
        residuals = [part.residual for part in parts if part.residual is not None]
        passed = sum(part.verdict == "pass" for part in parts)
        judged = passed + sum(part.verdict == "fail" for part in parts)
        columns = tuple(moments(column) for column in zip(*residuals, strict=True))
        yield LeafRow(leaf, len(parts), judged, passed, history.table.leaves[leaf].success, columns)


def _nodes(history: History) -> Iterable[NodeRow]:
    table = history.table
    trials = table.predicted.trials or PREDICTED_FROM
    predicted = branch_shares(table)
    for index, counts in enumerate(branch_counts(history.parts, table)):
        shares = tuple(predicted[index])
        statistic, freedom = chi_square(counts[:-1], shares)
        # The prediction is itself a count of trials: of two samples the difference scatters more.
        statistic /= 1.0 + len(history.parts) / trials
        yield NodeRow(index, tuple(counts), shares, statistic, freedom, chi_square_tail(statistic, freedom))
