"""The fault codes of a 2F gripper, and what to do about them."""

from typing import NamedTuple

from drivers.errors import GripperFault


class FaultText(NamedTuple):
    """Meaning of a gFLT code: its class, one sentence, and a remedy."""

    severity: str
    sentence: str
    remedy: str


MINOR, PRIORITY, MAJOR = "minor", "priority", "major"

# gFLT, low nibble of input byte 2: devices' fault status register (2F-85 manual, "Fault status").
FAULTS: dict[int, FaultText] = {
    0x05: FaultText(
        PRIORITY,
        "action delayed, activation must finish first",
        "wait for it, or activate the gripper",
    ),
    0x07: FaultText(
        PRIORITY, "the gripper is not activated", "clear the jaws and activate the gripper"
    ),
    0x08: FaultText(MINOR, "too hot (85 C or more inside)", "let it cool below 80 C"),
    0x09: FaultText(
        MINOR, "no communication for a second or more", "none: it clears with the next request"
    ),
    0x0A: FaultText(
        MAJOR, "supply voltage too low", "check the 24 V supply, then reset and activate"
    ),
    0x0B: FaultText(
        MAJOR, "automatic release in progress", "wait for it to end, then reset and activate"
    ),
    0x0C: FaultText(
        MAJOR, "internal fault", "reset and activate; if it returns, contact the maker"
    ),
    0x0D: FaultText(
        MAJOR,
        "activation failed, something blocked the jaws",
        "clear the jaws, then reset and activate",
    ),
    0x0E: FaultText(
        MAJOR, "overcurrent", "look for a jammed or overloaded finger, then reset and activate"
    ),
    0x0F: FaultText(MAJOR, "automatic release completed", "reset and activate"),
}


def fault_text(code: int) -> FaultText:
    """Meaning of a gFLT code; an unknown one counts as major, as Robotiq's own SDK treats it."""
    unknown = FaultText(MAJOR, f"unknown fault 0x{code:02X}", "reset and activate")
    return FAULTS.get(code, unknown)


def fault(code: int, doing: str) -> GripperFault:
    """The error for a gFLT code met while `doing` something."""
    text = fault_text(code)
    return GripperFault(f"gripper fault 0x{code:02X} while {doing}: {text.sentence}; {text.remedy}")
