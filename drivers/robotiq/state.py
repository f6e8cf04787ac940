"""One reading of the gripper: decoded, and checked before it is believed or acted upon."""

from functools import lru_cache
from typing import NamedTuple

from drivers.errors import MAJOR, PRIORITY, GripperFault, fault_text
from drivers.robotiq.registers import (
    COUNT_CLOSED,
    COUNT_OPEN,
    CURRENT_MA_PER_COUNT,
    INPUT_FIELDS,
    OBJ_AT_REQUEST,
    OBJ_CONTACT_CLOSING,
    OBJ_MOVING,
    STA_ACTIVATING,
    STA_ACTIVE,
    unpack,
)


class GripperState(NamedTuple):
    """One reading of the gripper.

    `activated` means ready to move; `activating` is the sweep; `going` echoes rGTO; `object_flag` is gOBJ (0
    moving, 1 contact opening, 2 contact closing, 3 at the request; meaningless unless `going`); `fault` is
    gFLT.
    """

    activated: bool
    activating: bool
    enabled: bool
    going: bool
    moving: bool
    fault: int
    controller_fault: int
    object_flag: int
    echo_counts: int
    position_counts: int
    current_ma: int


@lru_cache(1024)  # a gripper at rest says the same over and over
def decode(block: bytes) -> GripperState:
    """What an input block says."""
    fields = unpack(INPUT_FIELDS, block)
    enabled = fields["gACT"] == 1
    going = fields["gGTO"] == 1
    return GripperState(
        activated=enabled and fields["gSTA"] == STA_ACTIVE,
        activating=enabled and fields["gSTA"] == STA_ACTIVATING,
        enabled=enabled,
        going=going,
        moving=going and fields["gOBJ"] == OBJ_MOVING,
        fault=fields["gFLT"],
        controller_fault=fields["kFLT"],
        object_flag=fields["gOBJ"],
        echo_counts=fields["gPR"],
        position_counts=fields["gPO"],
        current_ma=fields["gCU"] * CURRENT_MA_PER_COUNT,
    )


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
