"""Measures where the fingers meet: grips a fixed block with the hand at two angles half a turn apart.

The block cannot move: the first finger that touches it stops both fingers. Along the hand's y let h be the
place of the hand, b the place of the block, and m the distance from the hand's middle at which the fingers
meet on the block. Let W be the block's width, and s the upper finger's share of the closing. If the jaws stop
at a width w = W + v, then

    h = b - m - s v          where the upper finger touches first,
    h = b - m + (1 - s) v    where the lower finger touches first.

If v is subtracted from the second h, both equations are the same line in v, with slope -s and value b - m at
v = 0. Half a turn of the hand changes the sign of b, but not of m: the mean of both values at v = 0 is -m.
"""

from collections.abc import Callable, Iterator, Sequence
from math import hypot, pi, sqrt
from statistics import fmean, linear_regression
from typing import NamedTuple

from drivers.ports import ObjectState
from runtime.errors import GripperStateError
from runtime.execution.hand import Hand
from runtime.execution.middle import MOST_MM, Middle
from runtime.execution.strokes import of_any_width
from runtime.shell.errors import InputError
from runtime.table import Node, Pose2, Table
from runtime.table.geometry import compose

ROOM_MM = 15.0  # clearance between a block in the middle and each open finger
# distance of the first two grips, which search for the block, from its stated place
COARSE_MM = 6.0
NEAR_MM = 4.0  # largest distance of the block from its stated place
# offsets of the final grips to either side of the block's place; several, so that rounding averages out
FINE_MM = (1.5, 2.5, 3.7, 5.0, 6.4, 8.0)
ROUGH_MM = 0.4  # largest standard deviation of the grips from the lines of a block held fast


class Grip(NamedTuple):
    """One grip of the block."""

    hand_mm: float  # place of the hand along its y, relative to the stated place of the block
    width_mm: float  # width at which the jaws stopped


def gripping(table: Table, block_mm: float) -> Node:
    """Builds the node by which a block is squeezed gently; it has one branch, for any width.

    If the block is in the middle, each open finger is `ROOM_MM` away from it.

    Raises:
        InputError: the block is too wide for the gripper.
    """
    gripper, widest_um = table.gripper, table.gripper.opening_um
    opening_um = round(1000 * (block_mm + 2.0 * ROOM_MM))
    if block_mm <= 0.0 or opening_um > widest_um:
        raise InputError(
            f"a block of {block_mm:g} mm; take one of up to {widest_um / 1000 - 2 * ROOM_MM:g} mm"
        )
    speed_um_s, force_mn = round(1000 * gripper.profile.gentle_mm_s), gripper.least_force_mn
    squeeze = table.nodes[0].squeeze._replace(
        opening_um=opening_um, speed_um_s=speed_um_s, force_mn=force_mn
    )
    return of_any_width(table.nodes[0], squeeze, widest_um)


def places(at: Pose2) -> Iterator[Pose2]:
    """Yields the poses of the hand farthest from the block's stated place `at` that `measure` may use.

    Both `at` and the poses are in mm, mm, rad.
    """
    most = max(COARSE_MM, NEAR_MM + max(FINE_MM))
    for turn in (0.0, pi):
        for off in (-most, most):
            yield compose((*at[:2], at[2] + turn), (0.0, off, 0.0))


def measure(
    hand: Hand, node: Node, block_mm: float, at: Pose2, tell: Callable[[str], object]
) -> Middle:
    """Grips a fixed block at several offsets, with the hand at two angles half a turn apart.

    Args:
        hand: at the retreat height, with nothing between the fingers; its `middle_mm` is 0.
        node: the result of `gripping`.
        block_mm: the block's width.
        at: the block's centre, and the hand's angle at which the jaws close square on it [mm, mm, rad].
        tell: receives a message for each angle of the hand.

    Returns:
        The measured place where the fingers meet.

    Raises:
        GripperStateError: the gripper is not ready, or closed without meeting the block.
        InputError: the readings do not fit a fixed block of that width there.
    """
    halves = []
    for turn in (0.0, pi):
        about = (*at[:2], at[2] + turn)
        result = _look(hand, node, block_mm, about)
        offs = [result + side * off for off in FINE_MM for side in (-1, 1)]
        grips = [_grip(hand, node, about, off) for off in offs]
        halves.append((result, grips))
        tell(f"{len(grips) + 2} grips with the hand {'turned half round' if turn else 'as stated'}")
    return fit(block_mm, halves)


def _look(hand: Hand, node: Node, block_mm: float, about: Pose2) -> float:
    """Grips the block at two offsets from `about`, to find roughly where it stands.

    Returns:
        The offset, mm, along the hand's y, at which both fingers touch the block at once.

    Raises:
        InputError: the block gives way, has another width, or stands too far from `about`.
    """
    below, above = (_grip(hand, node, about, off).width_mm for off in (-COARSE_MM, COARSE_MM))
    if below + above - 2.0 * block_mm < 2.0 * COARSE_MM:
        raise InputError(
            f"the jaws read {below:.2f} and {above:.2f} mm on a block of {block_mm:g} mm, {COARSE_MM:g} mm "
            "beside its middle: it gives way, or is another; hold it fast"
        )
    result = (below - above) / 4.0
    if abs(result) > NEAR_MM:
        raise InputError(
            f"the block stands about {result:+.1f} mm off, along the hand's y; correct --at"
        )
    return result


def _grip(hand: Hand, node: Node, about: Pose2, off_mm: float) -> Grip:
    place = compose(about, (0.0, off_mm, 0.0))
    hand.retreat()
    hand.jaws.open(node.squeeze)
    hand.travel(*place)
    hand.descend(*place)
    reading = hand.close(node)
    width_mm = hand.jaws.width_mm(reading.width_um)
    hand.release(node.squeeze)
    hand.retreat()
    if reading.object is not ObjectState.CLOSING:
        raise GripperStateError(
            f"the fingers closed at ({place[0]:.1f}, {place[1]:.1f}) mm and met no block; correct --at"
        )
    return Grip(off_mm, width_mm)


def fit(block_mm: float, halves: Sequence[tuple[float, Sequence[Grip]]]) -> Middle:
    """Computes where the fingers meet: fits a line to the grips at each of the hand's two angles.

    Args:
        block_mm: the block's width.
        halves: for each angle, the block's rough offset (`_look`) [mm], and the grips.

    Raises:
        InputError: the readings do not fit the block, or the fingers meet too far off the hand's middle.
    """
    lines = [_line(block_mm, result, grips) for result, grips in halves]
    rough = max(line.residual_mm for line in lines)
    if not rough <= ROUGH_MM:
        raise InputError(
            f"the readings scatter by {rough:.2f} mm about those of a {block_mm:g} mm block held fast; "
            "look at its width, at --angle, and that it does not give way"
        )
    across = -fmean(line.both_mm for line in lines)
    if not abs(across) <= MOST_MM:
        raise InputError(
            f"the fingers meet {across:+.1f} mm off the hand's middle; set the tool frame"
        )
    share = -fmean(line.slope for line in lines)
    across_error = hypot(*(line.both_error_mm for line in lines)) / 2.0
    share_error = hypot(*(line.slope_error for line in lines)) / 2.0
    return Middle(block_mm, across, across_error, share, share_error)


class _Line(NamedTuple):
    """Line fitted to the hand's places as a function of widths, for one angle of the hand."""

    both_mm: float  # place where both fingers touch at once
    slope: float  # minus the upper finger's share
    both_error_mm: float
    slope_error: float
    residual_mm: float


def _line(block_mm: float, measured_mm: float, grips: Sequence[Grip]) -> _Line:
    wider = [grip.width_mm - block_mm for grip in grips]
    # Where the lower finger touches first, v is subtracted, which gives the line of the other side.
    hand = [
        grip.hand_mm - (v if grip.hand_mm > measured_mm else 0.0)
        for grip, v in zip(grips, wider, strict=True)
    ]
    slope, both = linear_regression(wider, hand)
    squares = sum((h - both - slope * v) ** 2 for h, v in zip(hand, wider, strict=True))
    residual = sqrt(squares / (len(grips) - 2))
    mean = fmean(wider)
    spread = sum((v - mean) ** 2 for v in wider)
    both_error = residual * sqrt(1.0 / len(grips) + mean**2 / spread)
    return _Line(both, slope, both_error, residual / sqrt(spread), residual)
