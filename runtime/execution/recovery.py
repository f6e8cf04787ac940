"""Finds out what the hand may hold after a run broke off, and how it lets go without moving the part.

The part's last record in the journal determines what the hand may be doing:

- after `pushing` it holds nothing, and stands somewhere on its way to, along or back from the node's pushes;
- after `placed` it is at the node's place, with the fingers anywhere between open and closed;
- after `squeeze` it holds the part, drags it, has released it, or moves on;
- after `freed`, and before the first of these records, it touches nothing.

A squeeze that was interrupted is repeated.
"""

from math import pi, remainder, tau

from drivers.ports import ObjectState, PoseOfHand
from runtime.errors import BrokenRunError
from runtime.execution.hand import LEVEL_MM, Hand
from runtime.execution.reading import room_um
from runtime.execution.safety import PLACED_MM, PLACED_RAD
from runtime.journal.replay import Last, Replay
from runtime.table import REJECT, Node, Pose2, Table, close_alike
from runtime.table.geometry import from_segment, placement

ABORT_REMEDY = "clear the cell, then start with --after-crash abort"


def pending(broken: Replay, table: Table, hand: Hand) -> tuple[Node, int] | None:
    """Finds out whether a part must still be released after a run broke off.

    The journal and the hand, which must be at rest, decide.

    Returns:
        The node of the squeeze and the branch taken there; None if nothing is to be released.

    Raises:
        BrokenRunError: the hand does not stand where the run left it; the fingers read another width than
            with the part; or the part was being carried.
    """
    if broken.delivering:
        raise BrokenRunError(
            "the part was being carried when the run broke off; take it out of the fingers"
        )
    if broken.held_at is None or broken.last is Last.PUSHING:
        return None
    index, target = broken.held_at
    node = table.nodes[index]
    pose, state = hand.where(), hand.gripper.state()
    branch = REJECT if (taken := node.branch_to(target)) is None else taken
    place, let_go = placement(node.squeeze), placement(node.squeeze, node.release_point(branch))
    retreat_mm = hand.limits.retreat_height_um / 1000
    low = pose[2] < (hand.timing.regrasp_mm if broken.steps else retreat_mm) - LEVEL_MM
    alike = close_alike(table)
    closed = state.target_um < 0  # not if set to 0 for a push
    held = broken.last is Last.SQUEEZED and (closed or state.object is not ObjectState.AT_TARGET)
    if held or broken.last is Last.PLACED:
        if not (low and _between(pose, place, let_go, alike)):
            raise _moved(pose, "with the part between the fingers; take it out")
        if held and closed and broken.steps:
            now_um, before_um = state.width_um, broken.steps[-1].reading_um
            if abs(now_um - before_um) > room_um(hand.calibration.profile):
                raise BrokenRunError(
                    f"the fingers read {now_um / 1000:.2f} mm, the part was held at "
                    f"{before_um / 1000:.2f} mm: another, or gone; {ABORT_REMEDY}"
                )
        return node, branch
    if not broken.steps:
        return None  # before the first squeeze of a part nothing is known that a moved part could contradict
    after, again = table.nodes[broken.traversal.node], broken.traversal.again
    first = after.squeeze if again or not after.pushes else after.pushes[0]
    coming = let_go if broken.traversal.outcome else placement(first)
    ways = [(let_go, let_go), (coming, coming)] if low else [(let_go, coming)]
    if pose[2] > retreat_mm + PLACED_MM or not any(_between(pose, *way, alike) for way in ways):
        raise _moved(pose, "after it had let go of the part, which may have been moved too")
    return None


def _moved(pose: PoseOfHand, where: str) -> BrokenRunError:
    return BrokenRunError(
        f"the arm stands at ({pose[0]:.2f}, {pose[1]:.2f}, {pose[2]:.2f}) mm, not where the run broke off "
        f"{where}; {ABORT_REMEDY}"
    )


def _between(pose: PoseOfHand, start: Pose2, end: Pose2, alike: bool) -> bool:
    """Whether the hand stands on the straight way between two places, at any height.

    With `alike`, for fingers that close alike, angles half a turn apart count as equal.
    """
    turn = pi if alike else tau
    off_mm = from_segment(pose[:2], start[:2], end[:2])
    whole, done, left = (
        abs(remainder(a - b, turn))
        for a, b in ((end[2], start[2]), (pose[3], start[2]), (end[2], pose[3]))
    )
    return off_mm <= PLACED_MM and done + left <= whole + 2 * PLACED_RAD
