"""Summarises the parts of journals for a report.

A summary compares the success with the table's prediction, the measured poses with the predicted poses, and
the branches that parts took with the expected shares. It also holds the alarms and values of control charts.
"""

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

PREDICTED_FROM = 6000  # number of trials behind predicted shares, assumed if the table states none
# a refit would pay if the counts of branches have a smaller probability than this in the planned cell
STRANGE = 1e-3
GROUP = 50  # audited parts for one point of the p-chart


class Series(NamedTuple):
    """A chart to draw: lines over numbered steps, with limits."""

    heading: str  # what the chart shows, in plain words
    lines: tuple[Line, ...]
    limits: tuple[float, ...]  # values at which the chart alarms
    step: str  # what a step is, such as "squeeze" or "part"
    method: str  # what the values are, and the statistical method


class LeafRow(NamedTuple):
    """Row of a report: counts and residuals of the parts that ended at one leaf."""

    leaf: int  # index of the leaf
    parts: int  # number of parts
    judged: int  # number of these parts that an audit judged to pass or fail
    passed: int
    # success rate that the table predicts; None if no trial ended at the leaf
    predicted: float | None
    # residuals: mean and standard deviation of x [mm], of y [mm] and of theta [rad]; empty if no part was
    # measured
    residuals: tuple[tuple[float, float], ...]


class NameRow(NamedTuple):
    """Row of a report: a hypothesis, and how many parts ended at resolved leaves that name it."""

    name: str  # name of the hypothesis
    parts: int
    share: float  # share that the hypothesis has by the table


class NodeRow(NamedTuple):
    """Row of a report: compares the squeezes at one node with the predicted shares of its branches.

    The comparison is Pearson's chi-square test.
    """

    node: int  # index of the node
    counts: tuple[int, ...]  # number of squeezes on each branch; the last number is of the rejects
    shares: tuple[float, ...]  # predicted share of each branch
    statistic: float  # Pearson's statistic
    freedom: int  # degrees of freedom of the statistic
    tail: float  # probability of a larger statistic if the table is right


@dataclass(frozen=True, slots=True)
class Summary:
    """What a report shows of the parts in journals."""

    outcomes: dict[str, int]  # number of parts by outcome
    verdicts: dict[str, int]  # number of audited parts by verdict
    passed: int
    judged: int  # parts judged to pass or fail, of which `passed` passed
    interval: tuple[float, float]  # 95 % interval of the success rate
    predicted: float  # success rate that the table predicts
    agrees: bool  # whether the interval contains the predicted success rate
    leaves: tuple[LeafRow, ...]
    nodes: tuple[NodeRow, ...]
    tail: float  # probability of counts at all nodes that fit the table as badly, if the table is right
    alarms: tuple[Alarm, ...]
    charts: tuple[Series, ...]
    names: tuple[NameRow, ...] = ()  # one for each hypothesis; empty for a table of a single part

    @property
    def names_tail(self) -> float:
        """Probability that chance alone makes the counts in `names` differ this much from the table's shares.

        The probability is that of Pearson's chi-square test.
        """
        counts, shares = [row.parts for row in self.names], [row.share for row in self.names]
        return chi_square_tail(*chi_square(counts, shares))

    @property
    def refit(self) -> bool:
        """Whether a refit (`plan-refit`) would pay: enough parts, and readings that differ from the plan."""
        drifted = any(alarm.chart in DRIFTED for alarm in self.alarms)
        return sum(self.outcomes.values()) >= LEAST_REFIT and (drifted or self.tail < STRANGE)

    def fields(self) -> dict[str, object]:
        """The summary in the form of JSON, without leaves, nodes and charts."""
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
    """Summarises a history for a report.

    Args:
        history: the parts and their table.
        expected: the expected readings, for the chart of readings; None leaves this chart out.

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
        _counted(part.outcome for part in parts),
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
        """Heading of a chart: the sentence of its first alarm; without an alarm, one from `STEADY`."""
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
    """The chart of failures (a p-chart): the share of failures in each group of `GROUP` audited parts."""
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
    """Returns the number of parts that passed their audit, and the number that passed or failed."""
    passed = sum(part.verdict == "pass" for part in parts)
    return passed, passed + sum(part.verdict == "fail" for part in parts)


def _counted(names: Iterator[str]) -> dict[str, int]:
    return dict(sorted(Counter(names).items()))


def _names(history: History) -> Iterator[NameRow]:
    """Yields a row for each hypothesis; nothing for a table of a single part, or that has to name none."""
    table = history.table
    if not table.goal.identify:
        return
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
        # The predicted shares are counted in trials, and scatter, too: the statistic is reduced for that.
        statistic /= 1.0 + len(history.parts) / trials
        tail = chi_square_tail(statistic, freedom)
        yield NodeRow(index, tuple(counts), shares, statistic, freedom, tail)
