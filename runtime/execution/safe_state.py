"""The safe sequence in which every fault and every stop ends.

The declared safe state, in this order, each step tried even if the one before failed:

1. The fingers stop where they are; what they hold stays held.
2. The arm goes straight up to the retreat height, if its last motion was acknowledged; an arm whose state
   is not known is not moved, nor is one whose fingers may hold what is fixed to the table.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.ports import Arm, Gripper
from runtime.execution.hand import Hand
from runtime.table import Limits

DECLARED = (
    "fingers stopped where they are, arm straight up to the retreat height if its state is known"
)


HOLDS_FIXED = (
    "arm not moved: the fingers may hold what is fixed; open them before the arm goes up "
    "(grasp-runtime --put-down does both)"
)


def reach_safe_state(
    gripper: Gripper, arm: Arm, limits: Limits, *, arm_known: bool, may_hold_fixed: bool = False
) -> list[str]:
    """Brings the cell into the declared safe state as far as its devices respond; raises no error.

    Args:
        gripper: the gripper whose fingers are stopped.
        arm: the arm, which is raised.
        limits: limits of the table, including the retreat height.
        arm_known: whether it is known where the arm stands: its last motion was acknowledged.
        may_hold_fixed: whether the fingers may hold something that may be fixed to the table.

    Returns:
        One sentence a step: its success or failure.
    """
    fingers = _stop_fingers(gripper)
    if not arm_known:
        return [fingers, "arm not moved: state unknown"]
    return [fingers, HOLDS_FIXED if may_hold_fixed else _raise_arm(arm, limits)]


@contextmanager
def ending_safely(hand: Hand) -> Iterator[None]:
    """Context that brings the cell into the safe state on every exception, and adds notes to the exception.

    The arm is not raised if the fingers may hold something, since this may be a block that is clamped to the
    table.
    """
    try:
        yield
    except BaseException as error:
        known, fixed = hand.arm_known, hand.jaws.may_hold
        for note in reach_safe_state(
            hand.gripper, hand.arm, hand.limits, arm_known=known, may_hold_fixed=fixed
        ):
            error.add_note(note)
        raise


@contextmanager
def fingers_stop(gripper: Gripper) -> Iterator[None]:
    """Context that stops the fingers on every exception, and adds the result to the exception as a note."""
    try:
        yield
    except BaseException as error:
        error.add_note(_stop_fingers(gripper))
        raise


def _stop_fingers(gripper: Gripper) -> str:
    try:
        gripper.stop()
        seen = gripper.state()
    except Exception as error:  # on any error the arm still has to be brought up
        return f"fingers: NOT KNOWN TO BE STOPPED: {error}"
    if seen.moving:
        return "fingers: NOT KNOWN TO BE STOPPED: they still move"
    activity = "" if seen.activated else ", the gripper is not active"
    return f"fingers stopped at {seen.width_um / 1000:.2f} mm{activity}"


def _raise_arm(arm: Arm, limits: Limits) -> str:
    height_mm = limits.retreat_height_um / 1000
    try:
        x_mm, y_mm, z_mm, angle_rad = arm.pose()
        if z_mm < height_mm:
            arm.move_linear((x_mm, y_mm, height_mm, angle_rad), limits.arm_speed_um_s / 1000)
    except Exception as error:
        return f"arm: NOT KNOWN TO BE RETREATED: {error}"
    return f"arm at retreat height {height_mm:g} mm"
