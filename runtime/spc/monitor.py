"""All control charts of a table: their values, their alarms, and whether a refit of the job would pay.

A refit (`plan-refit`) learns from journals what is off in the cell. `Monitor` runs the charts over finished
runs, `Drift` during a run.
"""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from math import hypot, inf, log1p, sqrt
from typing import NamedTuple

from runtime.spc.charts import WINDOWS, BinomialWindowChart, Cusum, Ewma, GTestChart
from runtime.spc.expectation import LIMIT, Expectation, ShiryaevRoberts
from runtime.spc.history import History, NodeReading, Part
from runtime.table import PPM, Branch, Leaf, Prediction, Table, wilson_interval
from runtime.traversal.results import PartResult

# shift of widths to detect (worn fingers, a slipped encoder): two counts of the encoder
WIDTH_SHIFT_UM = 700.0
LEAST_WIDTH_SIGMA_UM = 150.0
FLOOR_SHARE = 1.0 / 12.0  # least standard deviation of residuals, as a share of the goal's distance
# least share of failures or rejects to expect, however small the predicted share is
LEAST_SHARE = 2e-3
NEAR_UM = 3000  # distance from a branch within which a rejected width is compared with this branch
COORDINATES = ("x", "y", "theta")
LEAST_REFIT = 20  # least parts for a refit
DRIFTED = ("widths", "branches", "readings", "rejects")  # charts of quantities that a refit learns
REFIT = "a refit would pay: plan-refit JOB.toml --journal J... -o JOB2.toml learns what is off in the cell"
RECENT = 120  # squeezes whose chart values are kept


class Alarm(NamedTuple):
    """An alarm that a control chart raised when a part was added."""

    place: int  # index of the part in the history
    number: int  # number of the part in its run; reports count all parts, from place 0
    chart: str  # name of the chart
    sentence: str  # what has changed, and what to do


MOVED = "look whether camera, table or arm have moved"
MEANING = {
    "widths": "widths drift: the gripper should be looked at for worn fingers; then calibrate the gripper",
    "branches": "parts take other branches than predicted: look for another lot, friction, a moved feeder",
    "readings": "readings are those of {}, not as planned: look for oil, dust, worn pads, another lot "
    "(where widths drift too, first for that)",
    "failures": "more parts fail the audit than predicted: stop, and look at the overlays",
    "rejects": "more parts are rejected than predicted: look for wrong parts, other friction, shifted widths",
    "residual x": f"measured poses have shifted in x: {MOVED}",
    "residual y": f"measured poses have shifted in y: {MOVED}",
    "residual theta": f"measured angles have shifted: {MOVED}",
}

# Headings of drawn charts without an alarm.
STEADY = {
    "failures": "Audits fail as rarely as predicted",
    "residual": "Measured poses agree with the answers",
    "widths": "Widths are steady",
    "readings": "Readings are those that were planned for",
}


class Monitor:
    """The control charts of one table: `add` sends a part to all charts, and returns their alarms.

    Only the parts within the charts' windows are kept. `drawn` holds the values that reports draw, by name:

    - `wider` and `narrower`: the cumulative sums of the chart of widths, after each squeeze;
    - `x`, `y` and `theta`: the means of the charts of residuals, after each measured part;
    - `friction`, if there are expected readings: the logarithm of 1 plus the statistic of the chart of
      readings, after each part.
    """

    def __init__(
        self, table: Table, expected: Expectation | None = None, keep: int | None = None
    ) -> None:
        """Sets the charts up for a table; no part has been added yet.

        Args:
            table: the table.
            expected: the expected readings of the table; None if not known.
            keep: number of latest values to keep for each name in `drawn`; None keeps all.
        """
        predicted = table.predicted
        rejects = round(predicted.reject_ppm / PPM * predicted.trials)
        _, rejected = wilson_interval(rejects, predicted.trials)
        shares = branch_shares(table)
        self.table, self.parts = table, 0  # number of parts so far
        self.widths = Cusum(WIDTH_SHIFT_UM)
        self.branches = tuple(GTestChart(shares, window) for window in WINDOWS)
        self.failures = BinomialWindowChart(failure_share(predicted))
        self.rejects = BinomialWindowChart(max(rejected, LEAST_SHARE))
        self.residuals = (Ewma(), Ewma(), Ewma())
        self.readings = None if expected is None else ShiryaevRoberts(expected)
        self.drawn = defaultdict[str, deque[float]](lambda: deque(maxlen=keep))

    def watch(self, history: History) -> Iterator[Alarm]:
        """Adds all parts of a history, and yields the alarms in order.

        Raises:
            UsageError: the expectation belongs to another table.
        """
        if self.readings is not None:
            self.readings.expected.check(history)
        for part in history.parts:
            yield from self.add(part)

    def add(self, part: Part) -> list[Alarm]:
        """Adds one part to all charts; returns the alarms that the part raises."""
        sentences = {chart: MEANING[chart] for chart in self._alarmed(part)}
        if self.readings is not None:
            world = self.readings.add(self.table, part)
            self.drawn["friction"].append(log1p(self.readings.value if world is None else LIMIT))
            if world is not None:
                sentences["readings"] = MEANING["readings"].format(world)
        place, self.parts = self.parts, self.parts + 1
        return [Alarm(place, part.number, *alarm) for alarm in sentences.items()]

    def _alarmed(self, part: Part) -> Iterator[str]:
        shifted = False
        for squeeze in part.squeezes:
            shifted |= self.widths.add(*deviation(self.table, squeeze))
            self.drawn["wider"].append(self.widths.up)
            self.drawn["narrower"].append(-self.widths.down)
        if shifted:
            yield "widths"
        taken = tuple((s.node, s.branch) for s in part.squeezes if s.branch is not None)
        strange = [chart.add(taken) for chart in self.branches]
        if any(strange):
            yield "branches"
        if part.verdict in ("pass", "fail") and self.failures.add(part.verdict == "fail"):
            yield "failures"
        ended = part.outcome in ("leaf", "reject", "unresolved")
        if ended and self.rejects.add(part.outcome == "reject"):
            yield "rejects"
        values = standardised(self.table, part)
        for name, chart, value in zip(COORDINATES, self.residuals, values, strict=False):
            if chart.add(value):
                yield f"residual {name}"
            self.drawn[name].append(chart.mean)


class Drift:
    """The control charts of a table during a run; `add` returns whether a refit (`plan-refit`) would pay."""

    def __init__(self, table: Table) -> None:
        self._charts = Monitor(table, keep=RECENT)
        self._drifted = False
        self._alarms: dict[str, Alarm] = {}  # the latest alarm of each chart

    def as_object(self) -> dict[str, object]:
        """The figures for the live page, in the form of JSON.

        They are the latest cumulative sums of the widths' chart, the limit of the sums, and the latest alarm
        of each chart.
        """
        drawn = self._charts.drawn
        return {
            **{name: [round(v, 2) for v in drawn[name]] for name in ("wider", "narrower")},
            "limit": self._charts.widths.limit,
            "alarms": [alarm._asdict() for alarm in self._alarms.values()],
        }

    def add(self, result: PartResult) -> bool:
        """Adds a part that has ended; returns whether a refit of the job (`plan-refit`) would pay now."""
        nodes = self._charts.table.nodes
        squeezes = (
            NodeReading(step.node, nodes[step.node].branch_to(step.target), step.width_um)
            for step in result.steps
        )
        part = Part(result.part, tuple(squeezes), result.outcome.value, result.leaf, result.audit)
        alarms = self._charts.add(part)
        self._alarms |= {alarm.chart: alarm for alarm in alarms}
        self._drifted |= any(alarm.chart in DRIFTED for alarm in alarms)
        return self._drifted and self._charts.parts >= LEAST_REFIT


def failure_share(predicted: Prediction) -> float:
    """The share of failures that the chart of failures expects, from a table's evaluation.

    Returns:
        The upper end of the 95 % confidence interval of the evaluation's share, at least `LEAST_SHARE`.
    """
    failed = round((PPM - predicted.success_ppm) / PPM * predicted.trials)
    return max(wilson_interval(failed, predicted.trials)[1], LEAST_SHARE)


def deviation(table: Table, squeeze: NodeReading) -> tuple[float, float]:
    """Compares a width that was read with the expected width of its branch.

    A rejected width is compared with the branch whose expected width is nearest.

    Returns:
        The deviation (read minus expected width) and its standard deviation, um. For a rejected width that is
        farther than `NEAR_UM` from this branch: 0 and infinity, so that the deviation does not count.
    """
    branches = table.nodes[squeeze.node].branches
    if squeeze.branch is None:
        nearest = min(branches, key=lambda b: abs(b.expected_um - squeeze.width_um))
        if not nearest.low_um - NEAR_UM <= squeeze.width_um <= nearest.high_um + NEAR_UM:
            return 0.0, inf
    else:
        nearest = branches[squeeze.branch]
    # All widths seen in planning lie within the branch's interval; the scatter is taken as that of an even
    # distribution over the interval.
    spread = (nearest.high_um - nearest.low_um) / sqrt(12.0)
    return float(squeeze.width_um - nearest.expected_um), hypot(spread, LEAST_WIDTH_SIGMA_UM)


def standardised(table: Table, part: Part) -> tuple[float, ...]:
    """A part's residual (measured minus predicted pose) in standard deviations, for the charts of residuals.

    The standard deviations are those of the leaf at which the part ended. The result (x, y, theta) is empty
    if the part's pose was not measured.
    """
    if part.residual is None or part.leaf is None:
        return ()
    scale = sigmas(table, table.leaves[part.leaf])
    return tuple(off / sigma for off, sigma in zip(part.residual, scale, strict=True))


def sigmas(table: Table, leaf: Leaf) -> tuple[float, float, float]:
    """Standard deviations of x, y and theta of the parts at a leaf, mm, mm, rad.

    Each is at least `FLOOR_SHARE` of the goal's distance. For the angle this distance is divided by the
    goal's weight rho, in mm per rad.
    """
    moments, goal = leaf.covariance, table.goal_of(leaf.hypothesis)
    floor_mm = FLOOR_SHARE * goal.distance_um / 1000.0
    floor_rad = floor_mm * 1000.0 / max(goal.rho_um, 1)
    return (
        max(0.1 * sqrt(max(moments.xx, 0)), floor_mm),
        max(0.1 * sqrt(max(moments.yy, 0)), floor_mm),
        max(0.01 * sqrt(max(moments.tt, 0)), floor_rad),
    )


def branch_shares(table: Table) -> list[list[float]]:
    """For each node, the predicted share of parts that take each branch.

    The shares are counted from the trials that the evaluation recorded at the leaves below each branch, and
    none is zero. At a node that no trial reached, the shares are the branches' probabilities in the table.
    """
    reached = [0] * len(table.nodes)

    def trials(target: int) -> int:
        return reached[target] if target >= 0 else table.leaves[~target].trials

    for index in reversed(range(len(table.nodes))):  # children come after their parents
        reached[index] = sum(trials(branch.target) for branch in table.nodes[index].branches)
    return [
        _shares(node.branches, [trials(branch.target) for branch in node.branches])
        for node in table.nodes
    ]


def _shares(branches: Sequence[Branch], trials: Sequence[int]) -> list[float]:
    if not any(trials):
        return [branch.probability_ppm / PPM for branch in branches]
    # Each branch gets half a trial more (Jeffreys): a branch that no trial took is rare, not impossible.
    total = sum(trials) + 0.5 * len(trials)
    return [(taken + 0.5) / total for taken in trials]


def branch_counts(parts: Iterable[Part], table: Table) -> list[list[int]]:
    """Counts the squeezes at each node by branch; the last count of a node is the number of rejects."""
    counts = [[0] * (len(node.branches) + 1) for node in table.nodes]
    for part in parts:
        for squeeze in part.squeezes:
            counts[squeeze.node][-1 if squeeze.branch is None else squeeze.branch] += 1
    return counts
