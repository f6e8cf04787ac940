"""Summary for a report: success against the prediction, residuals by leaf, fit of the branches, charts."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import log1p
from statistics import fmean, stdev
from typing import NamedTuple

from runtime.pages.charts import Line
from runtime.shell.plain_text import capital
from runtime.spc import monitor as monitors
from runtime.spc.charts import RARE, binomial_tail, chi_square, chi_square_tail
from runtime.spc.expectation import LIMIT, Expectation
from runtime.spc.history import History, Part, by_leaf
from runtime.spc.monitor import COORDINATES, DRIFTED, LEAST_REFIT, STEADY, Alarm, Monitor
from runtime.table import PPM, wilson_interval

PREDICTED_FROM = 6000  # assumed trials behind a share without a stated number
STRANGE = 1e-3  # probability of branches below which the cell differs from the planned one
GROUP = 50  # audited parts for one point of the p-chart


class Series(NamedTuple):
    """A chart to draw: values for each step, and limits."""

    heading: str  # heading in plain words
    lines: tuple[Line, ...]
    limits: tuple[float, ...]
    step: str
    method: str  # description of the values


class LeafRow(NamedTuple):
    """The parts that ended at one leaf."""

    leaf: int
    parts: int
    judged: int  # how many of the parts were judged to pass or fail
    passed: int
    predicted: float | None  # success rate that the table predicts, None where no trial ended there
    # mean and standard deviation of x [mm], y [mm] and theta [rad]; empty where none was measured
    residuals: tuple[tuple[float, float], ...]


class NameRow(NamedTuple):
    """The located parts that were identified as one of the table's hypotheses."""

    name: str
    parts: int
    share: float  # share of such parts that the table states


class NodeRow(NamedTuple):
    """The squeezes at one node, compared with the shares of the table by Pearson's chi-square test."""

    node: int
    counts: tuple[int, ...]  # count of each branch, and last of the rejects
    shares: tuple[float, ...]
    statistic: float
    freedom: int
    tail: float  # probability of a larger statistic if the table is right


@dataclass(frozen=True, slots=True)
class Summary:
    """Figures of the parts in journals: outcomes, verdicts, success, leaves, nodes and control charts."""

    outcomes: dict[str, int]
    verdicts: dict[str, int]
    passed: int
    judged: int  # parts judged to pass or fail, of which `passed` passed
    interval: tuple[float, float]
    predicted: float
    agrees: bool  # whether the interval contains the predicted success rate
    leaves: tuple[LeafRow, ...]
    nodes: tuple[NodeRow, ...]
    tail: float  # tail probability of the chi-square over all nodes
    alarms: tuple[Alarm, ...]
    charts: tuple[Series, ...]
    names: tuple[NameRow, ...] = ()  # for a table of several parts

    @property
    def names_tail(self) -> float:
        """Tail probability of the counts in `names` by the chi-square test against the stated shares."""
        counts, shares = [row.parts for row in self.names], [row.share for row in self.names]
        return chi_square_tail(*chi_square(counts, shares))

    @property
    def refit(self) -> bool:
        """Whether the readings differ from the planned cell's readings, so that a refit would pay."""
        drifted = any(alarm.chart in DRIFTED for alarm in self.alarms)
        return sum(self.outcomes.values()) >= LEAST_REFIT and (drifted or self.tail < STRANGE)

    def fields(self) -> dict[str, object]:
        """The summary in the form of JSON."""
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
            "refit_pays": self.refit,
            "alarms": [alarm._asdict() for alarm in self.alarms],
            **({"names": [row._asdict() for row in self.names]} if self.names else {}),
            **({"names_p": self.names_tail} if self.names else {}),
        }


def summarise(history: History, expected: Expectation | None = None) -> Summary:
    """Summarises a history; the chart of readings is included if the expectation is known.

    Raises:
        UsageError: the expectation belongs to another table.
    """
    parts, table = history.parts, history.table
    passed, judged = _judged(parts)
    interval, predicted = wilson_interval(passed, judged), table.predicted.success_ppm / PPM
    nodes = tuple(_nodes(history))
    statistic, freedom = sum(row.statistic for row in nodes), sum(row.freedom for row in nodes)
    monitor = Monitor(table, expected)
    alarms = tuple(monitor.watch(history))
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
        alarms,
        tuple(_charts(history, monitor, alarms)),
        tuple(_names(history)),
    )


def _charts(history: History, monitor: Monitor, alarms: Sequence[Alarm]) -> Iterator[Series]:
    def heading(chart: str) -> str:
        """Heading of a chart: the sentence of its first alarm, or a sentence that no chart alarmed."""
        sentences = (alarm.sentence for alarm in alarms if alarm.chart.startswith(chart))
        return capital(next(sentences, STEADY[chart]))

    def lines(*names: str) -> tuple[Line, ...]:
        return tuple(Line(name, list(monitor.drawn[name])) for name in names)

    yield failures(history)._replace(heading=heading("failures"))
    limit = monitor.residuals[0].limit
    method = "Measured less answered pose: weighted means (EWMA), in standard deviations."
    courses = lines(*COORDINATES)
    yield Series(heading("residual"), courses, (-limit, limit), "audited part", method)
    limit = monitor.widths.limit
    method = "Widths less those expected: cumulative sums (CUSUM)."
    courses = lines("wider", "narrower")
    yield Series(heading("widths"), courses, (-limit, limit), "squeeze", method)
    if monitor.readings is not None:
        method = "How much likelier readings are at another friction (logarithm; Shiryaev-Roberts)."
        limits = (log1p(LIMIT),)
        yield Series(heading("readings"), lines("friction"), limits, "part", method)


def failures(history: History) -> Series:
    """The p-chart: share of failures in each group of `GROUP` audited parts."""
    judged = [part.verdict == "fail" for part in history.parts if part.verdict in ("pass", "fail")]
    groups = [judged[k : k + GROUP] for k in range(0, len(judged), GROUP)]
    expected = monitors.failure_share(history.table.predicted)
    rare = (k for k in range(GROUP) if binomial_tail(k, GROUP, expected) < RARE)
    most = next(rare, GROUP)
    shares = tuple(sum(group) / len(group) for group in groups)
    method = f"Share that fails of each {GROUP} audited parts (p-chart)."
    lines = (Line("failures", shares),)
    return Series(STEADY["failures"], lines, (most / GROUP,), "group", method)


def _judged(parts: Sequence[Part]) -> tuple[int, int]:
    """Returns the number of parts that passed, and the number of parts that passed or failed."""
    passed = sum(part.verdict == "pass" for part in parts)
    return passed, passed + sum(part.verdict == "fail" for part in parts)


def _counted(names: Iterator[str]) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


def _names(history: History) -> Iterator[NameRow]:
    """Yields the number of located parts of each hypothesis; none for a table of a single part."""
    table = history.table
    resolved = (part.leaf for part in history.parts if part.outcome == "leaf")
    given = Counter(table.leaves[leaf].hypothesis for leaf in resolved if leaf is not None)
    for number, hypothesis in enumerate(table.hypotheses):
        yield NameRow(hypothesis.name, given[number], hypothesis.share_ppm / PPM)


def _leaves(history: History) -> Iterator[LeafRow]:
    for leaf, parts in by_leaf(history.parts):
        residuals = [part.residual for part in parts if part.residual is not None]
        passed, judged = _judged(parts)
        columns = zip(*residuals, strict=True)
        moments = tuple((fmean(each), stdev(each) if len(each) > 1 else 0.0) for each in columns)
        yield LeafRow(leaf, len(parts), judged, passed, history.table.leaves[leaf].success, moments)


def _nodes(history: History) -> Iterator[NodeRow]:
    table = history.table
    trials = table.predicted.trials or PREDICTED_FROM
    predicted = monitors.branch_shares(table)
    for index, counts in enumerate(monitors.branch_counts(history.parts, table)):
        shares = tuple(predicted[index])
        statistic, freedom = chi_square(counts[:-1], shares)
        # The prediction is itself a count of trials: the difference of two samples scatters more.
        statistic /= 1.0 + len(history.parts) / trials
        tail = chi_square_tail(statistic, freedom)
        yield NodeRow(index, tuple(counts), shares, statistic, freedom, tail)
