"""Register map and fault codes of Robotiq grippers as data, the same on every bus; decodes readings.

Sources: [M18] 2F-85 & 2F-140 manual 2018, "Control" (p. 54 for FC23, p. 62 for the map); [M16] the 2016
edition, p. 43 and 55; [M200] 2-Finger 200 manual 2013; [ME] Hand-E manual; [SDK] Robotiq's C++ SDK. Byte 2k
of a block is the high byte of register k.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from drivers.errors import GripperFault


class Field(NamedTuple):
    """A field of a register block: `width` bits of the byte with number `byte`, from bit `shift` up.

    `source` names the page of the manual, and says what the values mean.
    """

    name: str
    byte: int
    shift: int
    width: int
    source: str


BLOCK_BYTES = 6  # used bytes of 16; the rest is reserved and zero

# Host -> gripper.
OUTPUT_FIELDS = (
    Field("rACT", 0, 0, 1, "[M16] p43 ACTION REQUEST: 1 activates, 0 resets and clears faults"),
    Field("rGTO", 0, 3, 1, "[M16] p43 ACTION REQUEST: 1 goes to rPR, 0 stops"),
    Field("rATR", 0, 4, 1, "[M16] p43 ACTION REQUEST: 1 releases slowly, then fault 0x0F"),
    Field("rARD", 0, 5, 1, "[M18] p62: auto-release 0 closes, 1 opens (2F-200: the reverse)"),
    Field("rPR", 3, 0, 8, "[M18] p62 POSITION REQUEST: 0 open, 255 closed"),
    Field("rSP", 4, 0, 8, "[M18] p62 SPEED: 0 slowest, 255 fastest"),
    Field("rFR", 5, 0, 8, "[M18] p62 FORCE: 0 weakest, 255 strongest"),
)

# Gripper -> host.
INPUT_FIELDS = (
    Field("gACT", 0, 0, 1, "[M18] p62 GRIPPER STATUS: echo of rACT"),
    Field("gGTO", 0, 3, 1, "[M18] p62: echo of rGTO; 0 while activating or releasing"),
    Field("gSTA", 0, 4, 2, "[M18] p62 GRIPPER STATUS: 0 reset, 1 activating, 3 active"),
    Field("gOBJ", 0, 6, 2, "[M18] p62: 0 moving, 1 contact opening, 2 contact closing, 3 at rPR"),
    Field("gFLT", 2, 0, 4, "[SDK] fault_status.hpp: gripper fault, equality and not bit flags"),
    Field("kFLT", 2, 4, 4, "[SDK] fault_status.hpp: fault of the Universal Controller"),
    Field("gPR", 3, 0, 8, "[M18] p62 echo of rPR"),
    Field("gPO", 4, 0, 8, "[M18] p62 POSITION: encoder, 0 open, 255 closed"),
    Field("gCU", 5, 0, 8, "[M18] p62 CURRENT: 10 mA a count"),
)

CURRENT_MA_PER_COUNT = 10

STA_RESET, STA_ACTIVATING, STA_ACTIVE = 0, 1, 3
OBJ_MOVING, OBJ_CONTACT_OPENING, OBJ_CONTACT_CLOSING, OBJ_AT_REQUEST = 0, 1, 2, 3

# Meaning and remedy of each code in gFLT, the low nibble of input byte 2 ([M18] "Fault status").
FAULTS = {
    0x05: "action delayed, activation must finish first; wait for it, or activate the gripper",
    0x07: "the gripper is not activated; clear the jaws and activate the gripper",
    0x08: "too hot (85 C or more inside); let it cool below 80 C",
    0x09: "no communication for a second or more; none: it clears with the next request",
    0x0A: "supply voltage too low; check the 24 V supply, then reset and activate",
    0x0B: "automatic release in progress; wait for it to end, then reset and activate",
    0x0C: "internal fault; reset and activate; if it returns, contact the maker",
    0x0D: "activation failed, something blocked the jaws; clear the jaws, then reset and activate",
    0x0E: "overcurrent; look for a jammed or overloaded finger, then reset and activate",
    0x0F: "automatic release completed; reset and activate",
}
# Classes of faults ([M18] "Fault status"). All other faults are major: only a reset clears them.
PRIORITY = frozenset({0x05, 0x07})
MINOR = frozenset({0x08, 0x09})

# Speed and stroke of the 2F-85, [SDK] device_profile.hpp: linear in rSP. The whole stroke of a 2F-140 takes
# about as long, the stroke of a Hand-E less: deadlines computed from these hold for all three.
SPEED_MIN_MM_S, SPEED_MAX_MM_S = 20.0, 150.0
OPENING_MM, COUNT_OPEN, COUNT_CLOSED = 85.0, 3, 230


def pack(fields: tuple[Field, ...], values: Mapping[str, int]) -> bytes:
    """Packs named values into a block of 6 bytes; fields without a value are 0.

    Raises:
        ValueError: a name is not in the block, or a value does not fit its bits.
    """
    block = bytearray(BLOCK_BYTES)
    by_name = {field.name: field for field in fields}
    for name, value in values.items():
        if name not in by_name:
            raise ValueError(f"no register field {name}; there are {', '.join(by_name)}")
        field = by_name[name]
        if not 0 <= value < 1 << field.width:
            raise ValueError(f"{name} = {value} does not fit {field.width} bits")
        block[field.byte] |= value << field.shift
    return bytes(block)


def unpack(fields: tuple[Field, ...], block: bytes | bytearray) -> dict[str, int]:
    """Unpacks the values of all fields, by name, from a block; bytes after the sixth are ignored."""
    return {one.name: block[one.byte] >> one.shift & (1 << one.width) - 1 for one in fields}


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of a 2F gripper; positions are counts: 0 open, 255 closed."""

    activated: bool  # whether the activation is complete
    enabled: bool  # gACT, the echo of rACT
    activating: bool  # whether the gripper is being activated, for which the fingers sweep
    going: bool  # gGTO, the echo of rGTO; `object_flag` means nothing without it
    moving: bool  # whether the fingers are moving
    fault: int  # gFLT
    object_flag: int  # gOBJ
    echo_counts: int  # gPR
    position_counts: int  # gPO
    current_ma: int


@lru_cache(1024)  # a gripper at rest repeats itself
def decode(block: bytes) -> Reading:
    """Decodes an input block of at least 6 bytes."""
    fields = unpack(INPUT_FIELDS, block)
    enabled = fields["gACT"] == 1
    going = fields["gGTO"] == 1
    return Reading(
        activated=enabled and fields["gSTA"] == STA_ACTIVE,
        activating=enabled and fields["gSTA"] == STA_ACTIVATING,
        enabled=enabled,
        going=going,
        moving=going and fields["gOBJ"] == OBJ_MOVING,
        fault=fields["gFLT"],
        object_flag=fields["gOBJ"],
        echo_counts=fields["gPR"],
        position_counts=fields["gPO"],
        current_ma=fields["gCU"] * CURRENT_MA_PER_COUNT,
    )


def speed_mm_s_of(speed_counts: int) -> float:
    """Jaw speed in mm/s for an rSP of 0..255, linear ([SDK] device_profile.hpp)."""
    return SPEED_MIN_MM_S + (SPEED_MAX_MM_S - SPEED_MIN_MM_S) * speed_counts / 255.0


def fault_text(code: int) -> str:
    """Returns the meaning of a gFLT code, and the remedy."""
    return FAULTS.get(code, f"unknown fault 0x{code:02X}; reset and activate")


def is_major(code: int) -> bool:
    """Whether only a reset clears a fault; an unknown fault counts as major, as in Robotiq's own SDK."""
    return code != 0 and code not in PRIORITY | MINOR


def fault(code: int, doing: str) -> GripperFault:
    """Creates the error for a gFLT code that was read while `doing` (words for the message)."""
    return GripperFault(f"gripper fault 0x{code:02X} while {doing}: {fault_text(code)}")
