"""From a reading to a branch: a calibration converts the reading to a width, a decision map gives the branch.

`misfits` checks whether a gripper fits a table.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from drivers.ports import GripperProfile
from runtime.errors import TableError
from runtime.table.model import REJECT, Branch, GripperSpec, Node, Table


@dataclass(frozen=True, slots=True)
class Calibration:
    """Map from the widths that a gripper reads (nominal) to true widths.

    The map is linear between its points, and constant beyond the first and the last point.

    Raises:
        TableError: there is only one point, or the points do not rise.
    """

    profile: GripperProfile
    points_um: tuple[tuple[int, int], ...] = ()  # (nominal, true); empty: nominal widths are true

    def __post_init__(self) -> None:
        if len(self.points_um) == 1:
            raise TableError("a calibration has two points at least, this one has 1")
        for (nominal, true), (following, wider) in pairwise(self.points_um):
            if following <= nominal or wider < true:
                raise TableError(
                    f"a calibration's widths must rise with what is read; they do not at {following} um"
                )

    def width_um(self, reading_um: int) -> int:
        """The true width at a reading, um."""
        if not self.points_um:
            return min(max(reading_um, 0), self.profile.stroke_um)
        after = bisect_right(self.points_um, reading_um, key=lambda point: point[0])
        if after in (0, len(self.points_um)):
            return self.points_um[max(after - 1, 0)][1]
        (x0, y0), (x1, y1) = self.points_um[after - 1 : after + 1]
        return y0 + (2 * (y1 - y0) * (reading_um - x0) + x1 - x0) // (2 * (x1 - x0))

    @property
    def widest_um(self) -> int:
        """The true width of the jaws fully open, um."""
        return self.width_um(self.profile.stroke_um)

    def nearest_um(self, width_um: int) -> int:
        """The reading whose true width is nearest to `width_um`; of two such readings, the greater one."""
        wider = self.opening_um(width_um)
        step = self.profile.step(wider)
        less = self.profile.reading_um(max(step - 1, 0))
        off, off_less = (abs(self.width_um(each) - width_um) for each in (wider, less))
        return wider if off <= off_less else less

    def opening_um(self, width_um: int) -> int:
        """The least reading whose true width is at least `width_um`; if none, that of open jaws."""
        steps = range(self.profile.steps + 1)
        step = bisect_left(steps, width_um, key=self._width_at)
        return self.profile.reading_um(min(step, self.profile.steps))

    def reads(self, low_um: int, high_um: int) -> bool:
        """Whether the true width of some reading lies in an interval, ends included."""
        nearest_um = self.width_um(self.opening_um(low_um))
        return nearest_um <= high_um and self.widest_um >= low_um

    def _width_at(self, step: int) -> int:
        return self.width_um(self.profile.reading_um(step))


class Segments(NamedTuple):
    """The branch of a node as a step function of the true width.

    `branches[k]` applies from `starts_um[k]` up to, but not at, `starts_um[k + 1]`.
    """

    starts_um: tuple[int, ...]  # ascending, the first is 0
    branches: tuple[int, ...]  # an index into a node's branches, or `REJECT`; two neighbours differ

    def at(self, width_um: int) -> int:
        """The branch at a width; `REJECT` for a negative width."""
        return REJECT if width_um < 0 else self.branches[bisect_right(self.starts_um, width_um) - 1]

    def intervals(self) -> list[tuple[int, int, int]]:
        """The intervals of widths that select a branch: least width, greatest width, um, and the branch."""
        ends = [start - 1 for start in self.starts_um[1:]]  # the last segment is a `REJECT`
        return [
            (start, end, branch)
            for start, end, branch in zip(self.starts_um, ends, self.branches, strict=False)
            if branch != REJECT
        ]


class DecisionMap(NamedTuple):
    """The rule that assigns a branch or `REJECT` to every settled reading at a node."""

    unfelt: Segments  # without an object felt
    felt: Segments  # with an object felt

    @property
    def either(self) -> Segments:
        """The branch by the width alone, for callers without an object flag.

        If a width has a branch only with an object felt, or only without, that branch counts. If it has a
        branch in both cases, the branch with the higher index counts.
        """
        starts = sorted({*self.unfelt.starts_um, *self.felt.starts_um})
        return _segments(starts, [max(part.at(start) for part in self) for start in starts])


def decision_map(node: Node, gripper: GripperSpec) -> DecisionMap:
    """Builds the rule that assigns a branch or `REJECT` to every settled reading at a node (decision 0056).

    A branch is a grip if its interval excludes width 0 or its expected width is `HELD_UM` or more; any other
    branch means that nothing is held. Which branches are candidates for a reading depends on its object flag:

    - Object felt: the grips whose interval contains the width; none at width 0.
    - No object felt, width up to the gripper's `empty_um`: the branches that are no grips and whose interval
      contains the width. If there are none, the candidates are as for an object felt, since a thin part may
      not be felt.
    - No object felt, greater width: none.

    The candidate with the nearest expected width is chosen; of two equally near candidates, the one with the
    lower index. Without a candidate the reading is `REJECT`.
    """
    grips = [(number, branch) for number, branch in enumerate(node.branches) if branch.grip]
    empties = [(number, branch) for number, branch in enumerate(node.branches) if not branch.grip]
    starts = sorted({0, 1, gripper.empty_um + 1, *_cuts(grips), *_cuts(empties)})
    felt, unfelt = [], []
    for start in starts:
        grip = _nearest(grips, start) if start > 0 else REJECT
        empty = _nearest(empties, start)
        felt.append(grip)
        unfelt.append(REJECT if start > gripper.empty_um else grip if empty == REJECT else empty)
    return DecisionMap(_segments(starts, unfelt), _segments(starts, felt))


def _cuts(branches: list[tuple[int, Branch]]) -> set[int]:
    """The widths, um, at which the branch of a reading may change."""
    cuts = {cut for _, branch in branches for cut in (branch.low_um, branch.high_um + 1)}
    for k, (_, one) in enumerate(branches):
        for _, other in branches[k + 1 :]:
            if other.low_um <= one.high_um and one.low_um <= other.high_um:
                cuts.add((one.expected_um + other.expected_um) // 2 + 1)
    return cuts


def _nearest(branches: list[tuple[int, Branch]], width_um: int) -> int:
    """Of the branches whose interval contains a width, the one with the nearest expected width, or `REJECT`.

    `branches` are pairs of a branch's index and the branch; the index is returned.
    """
    within = [
        (abs(width_um - branch.expected_um), number)
        for number, branch in branches
        if branch.low_um <= width_um <= branch.high_um
    ]
    return min(within)[1] if within else REJECT


def _segments(starts: list[int], branches: list[int]) -> Segments:
    kept = [k for k in range(len(starts)) if k == 0 or branches[k] != branches[k - 1]]
    return Segments(tuple(starts[k] for k in kept), tuple(branches[k] for k in kept))


def decide(decided: DecisionMap, width_um: int, felt: bool) -> int:
    """Returns the branch that one settled reading selects.

    Args:
        decided: the decision map of the node.
        width_um: the true width.
        felt: whether the closing jaws stopped at an object, not at the end of their way.

    Returns:
        An index into the node's branches, or `REJECT`.
    """
    return (decided.felt if felt else decided.unfelt).at(width_um)


def unread(decided: DecisionMap, calibration: Calibration, branches: int) -> list[int]:
    """Indices of the branches of a node that no reading of a gripper selects.

    Args:
        decided: the decision map of the node.
        calibration: the calibration of the gripper.
        branches: the number of the node's branches.
    """
    read = {
        branch
        for segments in decided
        for low, high, branch in segments.intervals()
        if calibration.reads(low, high)
    }
    return [number for number in range(branches) if number not in read]


def misfits(table: Table, calibration: Calibration) -> list[str]:
    """Reasons why a gripper with a calibration cannot run a valid table: a sentence for each, with a remedy.

    To fit the table, the jaws must open as far as it requires. For each branch some reading must select the
    branch, and the reading nearest to its expected width must not select another branch.
    """
    problems, widest_um = [], calibration.widest_um
    for index, node in enumerate(table.nodes):
        if node.squeeze.opening_um > widest_um + table.gripper.noise_um:
            problems.append(
                f"node {index} opens to {node.squeeze.opening_um / 1000:.2f} mm, this gripper to "
                f"{widest_um / 1000:.2f} mm; recompile with its opening"
            )
        decided = decision_map(node, table.gripper)
        missing = unread(decided, calibration, len(node.branches))
        for number, branch in enumerate(node.branches):
            nearest = calibration.width_um(calibration.nearest_um(branch.expected_um))
            if number in missing:
                width = f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f} mm"
                problems.append(
                    f"node {index}, branch {number}: no reading of this gripper means {width}; "
                    "calibrate it again, or recompile the table for its encoder"
                )
            elif decide(decided, nearest, branch.grip) not in (number, REJECT):
                problems.append(
                    f"node {index}, branch {number}: this gripper reads {branch.expected_um / 1000:.2f} mm "
                    "as another branch; recompile the table for its encoder"
                )
    return problems
