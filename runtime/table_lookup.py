"""From an encoder count to the outcome it means: the calibration and the 256-entry map of a node."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from operator import gt
from typing import Self

from runtime.errors import TableError
from runtime.table_model import HELD_UM, UNDETECTED_UM, Branch, GripperSpec, Node

REJECT = -1
COUNTS = 256


@dataclass(frozen=True, slots=True)
class Calibration:
    """The width between the finger faces at each encoder count.

    Attributes:
        widths_um: 256 widths in um, never rising with the count.

    Raises:
        TableError: there are not 256 of them, or they rise somewhere.
    """

    widths_um: tuple[int, ...]
    _rising_um: tuple[int, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if len(self.widths_um) != COUNTS:
            raise TableError(f"a calibration has {COUNTS} widths, this one has {len(self.widths_um)}")
        rises = list(map(gt, self.widths_um[1:], self.widths_um))
        if any(rises):
            count = rises.index(True) + 1
            raise TableError(f"a calibration's widths must not rise with the count; they do at {count}")
        object.__setattr__(self, "_rising_um", self.widths_um[::-1])

    @classmethod
    def linear(cls, gripper: GripperSpec) -> Self:
        """The straight line between the two end counts, clamped at both ends (Robotiq SDK, units.cpp).

        Args:
            gripper: opening in um, `count_open` and `count_closed`.
        """
        span = gripper.count_closed - gripper.count_open
        steps = (min(max(gripper.count_closed - count, 0), span) for count in range(COUNTS))
        return cls(tuple((2 * gripper.opening_um * step + span) // (2 * span) for step in steps))

    def width_um(self, count: int) -> int:
        """The width at an encoder count, um."""
        return self.widths_um[count]

    def counts(self, low_um: int, high_um: int) -> range:
        """The counts whose widths lie in an interval, its ends included."""
        first = COUNTS - bisect_right(self._rising_um, high_um)
        return range(first, max(first, COUNTS - bisect_left(self._rising_um, low_um)))

    def means(self, low_um: int, high_um: int) -> bool:
        """Whether any count's width lies in an interval."""
        at = bisect_left(self._rising_um, low_um)
        return at < COUNTS and self._rising_um[at] <= high_um

    def count(self, width_um: int) -> int:
        """The count whose width is nearest to `width_um`; the more open one of two equally near."""
        return min(range(COUNTS), key=lambda count: (abs(self.widths_um[count] - width_um), count))


def count_map(node: Node, calibration: Calibration) -> tuple[int, ...]:
    """What the width of each encoder count says at a node, for drawings; `decisions` judges readings.

    Among the branches whose interval contains the width, the one with the nearest expected width (the lower
    one of two equally near); none: `REJECT`.

    Args:
        node: the node, its branches ordered by low and by expected width.
        calibration: counts to widths.

    Returns:
        256 entries, an index into `node.branches` or `REJECT`.
    """
    outcomes = [REJECT] * COUNTS
    ranges = won(node.branches)
    if ranges is None:
        return tuple(_nearest(node.branches, width) for width in calibration.widths_um)
    for index, (least, greatest) in enumerate(ranges):
        counts = calibration.counts(least, greatest)
        outcomes[counts.start : counts.stop] = [index] * len(counts)
    return tuple(outcomes)


def decisions(node: Node, calibration: Calibration) -> tuple[int, ...]:
    """What each settled reading of a closing motion means at a node (decision 0020).

    A branch of expected width `HELD_UM` or more is a grip, and never read where the jaws are fully closed; a
    narrower one means that nothing is held. With an object felt only a grip is believed. With none felt no
    width above `UNDETECTED_UM` is believed; up to it a grip may have gone unfelt. All else is `REJECT`.

    Args:
        node: the node.
        calibration: counts to widths.

    Returns:
        512 entries for `decide`: each count without an object, then each count with one.
    """
    outcomes = count_map(node, calibration)
    grips = [branch.expected_um >= HELD_UM for branch in node.branches]
    unfelt, felt = [REJECT] * COUNTS, [REJECT] * COUNTS
    for count, (outcome, width) in enumerate(zip(outcomes, calibration.widths_um, strict=True)):
        if outcome != REJECT and (width > 0 or not grips[outcome]):
            unfelt[count] = outcome if width <= UNDETECTED_UM else REJECT
            felt[count] = outcome if grips[outcome] else REJECT
    return (*unfelt, *felt)


def decide(decided: tuple[int, ...], count: int, object_detected: bool) -> int:
    """What one settled reading means: an index into the node's branches, or `REJECT`; one look-up.

    Args:
        decided: the node's `decisions`.
        count: settled encoder count; outside 0..255 it is no count, and a `REJECT`.
        object_detected: whether the closing jaws stopped at an object (flag 2), not at the end of their way.
    """
    if not 0 <= count < COUNTS:
        return REJECT
    return decided[count + COUNTS] if object_detected else decided[count]


def won(branches: tuple[Branch, ...]) -> list[tuple[int, int]] | None:
    """The least and the greatest width at which each branch is taken, least > greatest where it never is.

    Args:
        branches: ordered by low and by expected width.

    Returns:
        One pair a branch, um; None where a later interval ends before an earlier one, so that a branch may be
        taken in two places.
    """
    ranges = [(branch.low_um, branch.high_um) for branch in branches]
    for number in range(1, len(branches)):
        below, above = branches[number - 1], branches[number]
        if above.high_um < below.high_um:
            return None
        if above.low_um <= below.high_um:
            middle = (below.expected_um + above.expected_um) // 2
            least, _ = ranges[number - 1]
            ranges[number - 1] = least, min(below.high_um, max(middle, above.low_um - 1))
            ranges[number] = max(above.low_um, min(middle, below.high_um) + 1), above.high_um
    return ranges


def _nearest(branches: tuple[Branch, ...], width_um: int) -> int:
    distances = [
        (abs(width_um - branch.expected_um), number)
        for number, branch in enumerate(branches)
        if branch.low_um <= width_um <= branch.high_um
    ]
    return min(distances)[1] if distances else REJECT
