"""Errors of devices; a driver converts every error of a library to one of these.

::

    UnreachableError
     +- LinkError        the gripper cannot be reached: check cable, power, port (a ConnectionError)
     |   +- LinkTimeout  the gripper did not answer in time (a TimeoutError)
     +- PortError        a port cannot be opened: check its name and permissions (an OSError)
    DeviceError
     +- ArmError         the arm is silent, gone or answers nonsense (a ConnectionError)
     +- GripperFault     the gripper reports a fault, or does not follow a request (a RuntimeError)
     +- PictureError     the camera's picture cannot be measured
"""

from runtime.shell.errors import DeviceError, UnreachableError

SHOWN = 60  # characters of a device's message that an error shows


def shown(sent: object) -> str:
    """Formats data from a device for a message: shortened, with control characters escaped."""
    text = sent.decode("latin-1") if isinstance(sent, bytes) else str(sent)
    letters = text[:SHOWN].strip()
    plain = "".join(one if one.isprintable() else ascii(one)[1:-1] for one in letters)
    return plain if len(text) <= SHOWN else f"{plain}... ({len(text)} characters)"


def read_late(late_s: float) -> str:
    """Returns the words that follow a device's name in the message about a late read.

    They say that the device answered, that this process read the answer `late_s` too late, and what to do.
    """
    return (
        f"answered, but this process was stopped or starved and read it {late_s:.1f} s too late; "
        "take load off this machine"
    )


class LinkError(UnreachableError, ConnectionError):
    """The gripper cannot be reached: port unplugged, connection lost, refused request."""


class LinkTimeout(LinkError, TimeoutError):  # noqa: N818 - it is a TimeoutError, and named as one
    """The gripper did not answer in time: wrong slave id, no power, noise, or a broken wire."""


class GripperFault(DeviceError, RuntimeError):  # noqa: N818 - the manual calls it a fault
    """The gripper reports a fault, or does not follow a request."""


class ArmError(DeviceError, ConnectionError):
    """The arm is silent, gone, refuses, or answers nonsense; after a silence its state is unknown."""


class PortError(UnreachableError, OSError):
    """A port cannot be opened: no such device, no permission, in use, or no listener."""


class PictureError(DeviceError):
    """A picture cannot be read, or its tags cannot be measured."""


class ReadOnlyError(RuntimeError):
    """The program was about to command a device that was opened read-only: a bug. Nothing was sent."""
