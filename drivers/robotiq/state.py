"""One reading of the gripper, decoded."""

from functools import lru_cache
from typing import NamedTuple

from drivers.robotiq.registers import (
    CURRENT_MA_PER_COUNT,
    INPUT_FIELDS,
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
