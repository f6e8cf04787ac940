"""State of a broken run, and how to free the hand without moving the part.

A part's last record determines what the hand may be doing: after `pushing` it holds nothing, and
stands anywhere on its way to, along or back from the node's pushes; after `placed` the fingers may be
anywhere between open and closed at that node's place; after `squeeze` they hold the part, drag it, have
released it, or are moving; after `freed`, and before the first record, they touch nothing. A squeeze cut
short is repeated.
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
    """Finds the release that a broken run did not get to, from its journal and the hand at rest.

    Returns:
        The node of the squeeze and the branch taken there; None if nothing is to be released.

    Raises:
        BrokenRunError: the hand does not stand where the run left it or holds something else, or the part may
            be in the air.
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

    If the fingers close alike, a hand turned by half a turn is the same.
    """
    turn = pi if alike else tau
    off_mm = from_segment(pose[:2], start[:2], end[:2])
    whole, done, left = (
        abs(remainder(a - b, turn))
        for a, b in ((end[2], start[2]), (pose[3], start[2]), (end[2], pose[3]))
    )
    return off_mm <= PLACED_MM and done + left <= whole + 2 * PLACED_RAD
