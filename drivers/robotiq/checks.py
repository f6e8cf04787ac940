"""What a reading of the gripper is checked for before it is believed or acted upon."""

from drivers.errors import MAJOR, PRIORITY, GripperFault, fault_text
from drivers.robotiq.registers import COUNT_CLOSED, COUNT_OPEN, OBJ_AT_REQUEST, OBJ_CONTACT_CLOSING
from drivers.robotiq.state import GripperState

ARRIVED_COUNTS = 12  # gOBJ 3 farther than this from the request contradicts the count (open ends at 3 to 13)


def agrees(seen: GripperState, asked: int, start: int) -> bool:
    """Whether gOBJ fits the count: a flag left over from the move before, or a stuck one, mostly does not.

    Args:
        seen: the reading.
        asked: the position the move was to reach, counts.
        start: where it began, counts.
    """
    if seen.object_flag == OBJ_AT_REQUEST:
        # Beyond the end stops there is no telling how far the jaws go: that depends on the fingers.
        short = min(asked, COUNT_CLOSED) - seen.position_counts
        beyond = seen.position_counts - max(asked, COUNT_OPEN)
        return short <= ARRIVED_COUNTS and (asked >= COUNT_CLOSED or beyond <= ARRIVED_COUNTS)
    closing = seen.object_flag == OBJ_CONTACT_CLOSING
    return asked == start or closing == (asked > start)


def accept_any(seen: GripperState, doing: str) -> None:
    """Check nothing: a reset clears whatever fault there is."""


def refuse_major(seen: GripperState, doing: str) -> None:
    """Check for a latched fault.

    Raises:
        GripperFault: there is one.
    """
    if seen.fault and fault_text(seen.fault).severity == MAJOR:
        raise GripperFault.from_code(seen.fault, doing)


def require_ready(seen: GripperState, doing: str) -> None:
    """Check that the gripper may be moved.

    Raises:
        GripperFault: it reports a fault that forbids it, or is not active.
    """
    if seen.fault and fault_text(seen.fault).severity in {MAJOR, PRIORITY}:
        raise GripperFault.from_code(seen.fault, doing)
    if not seen.activated:
        raise GripperFault(
            f"gripper not active while {doing}; clear the jaws and activate it (--activate)", 0x07
        )


def sketch(seen: GripperState) -> str:
    """A reading in a few words."""
    return (
        f"gOBJ {seen.object_flag}, request {seen.echo_counts}, position {seen.position_counts}, "
        f"fault 0x{seen.fault:02X}"
    )
