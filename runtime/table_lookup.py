"""From an encoder count to the outcome it means: the calibration and the 256-entry map of a node."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Self

from runtime.errors import TableError
from runtime.table_model import GripperSpec, Node

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

    def __post_init__(self) -> None:
        if len(self.widths_um) != COUNTS:
            raise TableError(f"a calibration has {COUNTS} widths, this one has {len(self.widths_um)}")
        for count in range(1, COUNTS):
            if self.widths_um[count] > self.widths_um[count - 1]:
                raise TableError(f"a calibration's widths must not rise with the count; they do at {count}")

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

    def count(self, width_um: int) -> int:
        """The count whose width is nearest to `width_um`; the more open one of two equally near."""
        return min(range(COUNTS), key=lambda count: (abs(self.widths_um[count] - width_um), count))


def count_map(node: Node, calibration: Calibration) -> tuple[int, ...]:
    """What each encoder count means at a node.

    Among the branches whose interval contains the width, the one with the nearest expected width (the lower
    one of two equally near); none: `REJECT`.

    Args:
        node: the node, its branches ordered by width.
        calibration: counts to widths.

    Returns:
        256 entries, an index into `node.branches` or `REJECT`.
    """
    widths = calibration.widths_um
    outcomes = [REJECT] * COUNTS
    for index, branch in enumerate(node.branches):
        # Widths fall with the count: search them as a rising sequence of their negatives.
        first = bisect_left(widths, -branch.high_um, key=int.__neg__)
        last = bisect_right(widths, -branch.low_um, key=int.__neg__)
        for count in range(first, last):
            held = outcomes[count]
            distance = abs(widths[count] - branch.expected_um)
            if held == REJECT or distance < abs(widths[count] - node.branches[held].expected_um):
                outcomes[count] = index
    return tuple(outcomes)
