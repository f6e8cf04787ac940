"""What can go wrong with a device: any error of a library leaves a driver as one of these.

::

    UnreachableError
     +- LinkError        the gripper cannot be reached: check cable, power, port (a ConnectionError)
     |   +- LinkTimeout  it did not answer in time (a TimeoutError)
     +- PortError        a port cannot be opened: check its name and permissions (an OSError)
    DeviceError
     +- ArmError         the arm is silent, gone or answers nonsense (a ConnectionError)
     +- GripperFault     the gripper reports a fault, or does not follow a request (a RuntimeError)
     +- PictureError     the camera's picture cannot be measured
"""

from typing import NamedTuple

from runtime.shell.errors import DeviceError, UnreachableError

SHOWN = 60  # characters of what a device sent that a sentence shows


def shown(sent: object) -> str:
    """What a device sent, bytes or text, for a sentence: shortened, and without control characters."""
    text = sent.decode("latin-1") if isinstance(sent, bytes) else str(sent)
    plain = "".join(
        letter if letter.isprintable() else ascii(letter)[1:-1] for letter in text[:SHOWN].strip()
    )
    return plain if len(text) <= SHOWN else f"{plain}... ({len(text)} characters)"


class LinkError(UnreachableError, ConnectionError):
    """The gripper cannot be reached: port unplugged, connection lost, refused request."""


class LinkTimeout(LinkError, TimeoutError):  # noqa: N818 - it is a TimeoutError, and named as one
    """The gripper did not answer in time: wrong slave id, no power, noise, or a broken wire."""


class FaultText(NamedTuple):
    """What a gFLT code means: its class, one sentence, and what to do."""

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


class GripperFault(DeviceError, RuntimeError):  # noqa: N818 - the manual calls it a fault
    """The gripper reports a fault, or does not follow a request."""

    @classmethod
    def from_code(cls, code: int, doing: str) -> "GripperFault":
        """The fault for a gFLT code met while `doing` something."""
        text = fault_text(code)
        return cls(f"gripper fault 0x{code:02X} while {doing}: {text.sentence}; {text.remedy}")


class ArmError(DeviceError, ConnectionError):
    """The arm is silent, gone, refuses, or answers nonsense; after a silence its state is unknown."""


class PortError(UnreachableError, OSError):
    """A port cannot be opened: no such device, no permission, in use, or nobody listening."""


class PictureError(DeviceError):
    """A picture cannot be read, or its tags cannot be measured."""


class ReadOnlyError(RuntimeError):
    """A device opened for reading was to do something, which is a bug; nothing was sent."""
