"""From a reading to the outcome it means: a gripper's calibration, the map of a node, whether both fit."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from operator import neg
from typing import Self

from runtime.errors import TableError
from runtime.table.model import UNDETECTED_UM, GripperSpec, Node, Table

REJECT = -1
COUNTS = 256


@dataclass(frozen=True, slots=True)
class Calibration:
    """The width between the finger faces at each of the 256 counts, um, never rising with the count.

    Raises:
        TableError: there are not 256 of them, or they rise somewhere.
    """

    widths_um: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.widths_um) != COUNTS:
            raise TableError(
                f"a calibration has {COUNTS} widths, this one has {len(self.widths_um)}"
            )
        for count in range(1, COUNTS):
            if self.widths_um[count] > self.widths_um[count - 1]:
                raise TableError(
                    f"a calibration's widths must not rise with the count; they do at {count}"
                )

    @classmethod
    def linear(cls, gripper: GripperSpec) -> Self:
        """The straight line between the two end counts, clamped at both ends (Robotiq SDK, units.cpp)."""
        span = gripper.count_closed - gripper.count_open
        steps = (min(max(gripper.count_closed - count, 0), span) for count in range(COUNTS))
        return cls(tuple((2 * gripper.opening_um * step + span) // (2 * span) for step in steps))

    def width_um(self, count: int) -> int:
        """The width at an encoder count, um."""
        return self.widths_um[count]

    def counts(self, low_um: int, high_um: int) -> range:
        """The counts whose widths lie in an interval, its ends included."""
        first = bisect_left(self.widths_um, -high_um, key=neg)
        return range(first, bisect_right(self.widths_um, -low_um, key=neg))

    def count(self, width_um: int) -> int:
        """The count whose width is nearest to `width_um`; the more open one of two equally near."""
        return min(range(COUNTS), key=lambda count: (abs(self.widths_um[count] - width_um), count))


def decision_map(node: Node, calibration: Calibration) -> tuple[int, ...]:
    """What every settled reading of a closing motion means at a node: the whole rule (decision 0020).

    Of the branches whose interval contains the width, and which the flag admits, the one of the nearest
    expected width is meant, the lower of two equally near. A branch that does not reach down to width 0, or
    is expected at `HELD_UM` or more, is a grip, and never read at width 0; any other means that nothing is
    held. With an object felt only grips are admitted. With none felt no width above `UNDETECTED_UM` is
    believed; up to it nothing was held, or, where no branch says that, a grip went unfelt. All else is
    `REJECT`.

    Returns:
        512 entries, each an index into `node.branches` or `REJECT`: at each count with no object felt, then
        at each count with one felt.
    """
    grips = _nearest(node, True, calibration)
    empty = _nearest(node, False, calibration)
    felt = [
        number if width > 0 else REJECT
        for number, width in zip(grips, calibration.widths_um, strict=True)
    ]
    unfelt = [
        REJECT if width > UNDETECTED_UM else held if number == REJECT else number
        for number, held, width in zip(empty, felt, calibration.widths_um, strict=True)
    ]
    return (*unfelt, *felt)


def _nearest(node: Node, grip: bool, calibration: Calibration) -> list[int]:
    """At each count the branch of the nearest expected width, of the grips or of the others."""
    taken, nearest = [REJECT] * COUNTS, [0] * COUNTS
    for number, branch in enumerate(node.branches):
        if branch.grip != grip:
            continue
        for count in calibration.counts(branch.low_um, branch.high_um):
            distance = abs(calibration.widths_um[count] - branch.expected_um)
            if taken[count] == REJECT or distance < nearest[count]:
                taken[count], nearest[count] = number, distance
    return taken


def by_count(decided: tuple[int, ...]) -> tuple[int, ...]:
    """A `decision_map` as drawings show it: what each of the 256 counts means, with the flag that it needs.

    Where the flag decides between nothing and a thin grip, it is the grip.
    """
    return tuple(map(max, decided[:COUNTS], decided[COUNTS:]))


def decide(decided: tuple[int, ...], count: int, felt: bool) -> int:
    """What one settled reading means: an index into the node's branches, or `REJECT`; one look-up.

    A count outside 0..255 is none, and a `REJECT`; `felt` says whether the closing jaws stopped at an object
    (flag 2), not at the end of their way.
    """
    return decided[count + COUNTS * felt] if 0 <= count < COUNTS else REJECT


def misfits(table: Table, calibration: Calibration) -> list[str]:
    """What keeps a valid table from a gripper's own map of counts: a sentence a problem, with a remedy.

    The jaws must open as far as the table asks, and every branch must be read at one count at least, and not
    as another branch at the count nearest to its expected width.
    """
    problems, widest_um = [], calibration.widths_um[0]
    for index, node in enumerate(table.nodes):
        if node.squeeze.opening_um > widest_um + table.gripper.encoder_noise_um:
            problems.append(
                f"node {index} opens to {node.squeeze.opening_um / 1000:.2f} mm, this gripper to "
                f"{widest_um / 1000:.2f} mm; recompile with its opening"
            )
        decided = decision_map(node, calibration)
        for number, branch in enumerate(node.branches):
            nearest = calibration.count(branch.expected_um)
            if number not in decided:
                width = f"{branch.low_um / 1000:.2f}..{branch.high_um / 1000:.2f} mm"
                problems.append(
                    f"node {index}, branch {number}: no count of this gripper means {width}; "
                    "calibrate it again, or recompile the table for its encoder"
                )
            elif decide(decided, nearest, branch.grip) not in (number, REJECT):
                problems.append(
                    f"node {index}, branch {number}: this gripper reads {branch.expected_um / 1000:.2f} mm "
                    "as another branch; recompile the table for its encoder"
                )
    return problems
