"""The fault codes of a 2F gripper, and what to do about them."""

from drivers.errors import GripperFault

# Meaning and remedy of each code in gFLT, the low nibble of input byte 2 (2F-85 manual, "Fault status").
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
PRIORITY = frozenset({0x05, 0x07})
MINOR = frozenset({0x08, 0x09})


def fault_text(code: int) -> str:
    """Meaning of a gFLT code, and the remedy."""
    return FAULTS.get(code, f"unknown fault 0x{code:02X}; reset and activate")


def is_major(code: int) -> bool:
    """Whether only a reset clears a fault; an unknown one counts as major, as in Robotiq's own SDK."""
    return code != 0 and code not in PRIORITY | MINOR


def fault(code: int, doing: str) -> GripperFault:
    """The error for a gFLT code met while `doing` something."""
    return GripperFault(f"gripper fault 0x{code:02X} while {doing}: {fault_text(code)}")
