"""The one safe sequence every fault and every stop ends in.

The declared safe state, in this order, each step tried even if the one before failed:

1. The fingers stop where they are; what they hold stays held.
2. The arm goes straight up to the retreat height, if its last motion was acknowledged; an arm whose state
   is not known is not moved.
"""

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.ports import Arm, Gripper
from runtime.table import Limits

DECLARED = "fingers stopped where they are, arm straight up to the retreat height if its state is known"


def reach_safe_state(gripper: Gripper, arm: Arm, limits: Limits, *, arm_known: bool) -> list[str]:
    """Bring the cell into the declared safe state as far as its devices respond; nothing is raised.

    The arm is moved only if it is `arm_known` where it stands: its last motion was acknowledged. Returns one
    sentence a step: what was reached, and what failed.
    """
    return [_stop_fingers(gripper), _raise_arm(arm, limits) if arm_known else "arm not moved: state unknown"]


@contextmanager
def fingers_stop(gripper: Gripper) -> Iterator[None]:
    """Stop the fingers on every exception; what came of it is a note of the error, told with it."""
    try:
        yield
    except BaseException as error:
        error.add_note(_stop_fingers(gripper))
        raise


def _stop_fingers(gripper: Gripper) -> str:
    try:
        gripper.stop()
        seen = gripper.state()
    except Exception as error:  # whatever it is, the arm still has to be brought up
        return f"fingers: NOT KNOWN TO BE STOPPED: {error}"
    if seen.moving:
        return "fingers: NOT KNOWN TO BE STOPPED: they still move"
    activity = "" if seen.activated else ", the gripper is not active"
    return f"fingers stopped at count {seen.position_counts}{activity}"


def _raise_arm(arm: Arm, limits: Limits) -> str:
    height_mm = limits.retreat_height_um / 1000
    try:
        x_mm, y_mm, z_mm, angle_rad = arm.pose()
        if z_mm < height_mm:
            arm.move_linear(x_mm, y_mm, height_mm, angle_rad, limits.arm_speed_um_s / 1000)
    except Exception as error:
        return f"arm: NOT KNOWN TO BE RETREATED: {error}"
    return f"arm at retreat height {height_mm:g} mm"
