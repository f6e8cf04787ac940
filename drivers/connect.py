"""Open a device by its port name: the one module a runtime needs from this package.

Gripper ports: a tty path (Modbus RTU, 115200 8N1, slave 9), `rtu+tcp://host:port` (RTU frames over a raw TCP
port), `tcp://host:port` (Modbus TCP), `can:channel` (CANopen, see `drivers.robotiq.canopen`). Arms:
`tcp://host:port`, with frames and limits after a `?`:
`tcp://192.168.125.1:5000?tool=0,0,150&base=-300,0,0`. Simulated scenes: `tcp://host:port`.

A device of another make is one more line in `GRIPPERS` or `ARMS`: a scheme, and the function that opens it.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlsplit

from drivers.clock import Pace, WallClock
from drivers.errors import PortError
from drivers.robotiq.link import Report, no_report

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.ports import Arm, Gripper
    from drivers.robotiq.modbus import Answered, ModbusLink
    from drivers.sim.physics.scene_protocol import Scene

TTY = "tty"  # the scheme of a port without one

# Scheme -> module:function. Imported when first used: a program that opens no gripper loads no pymodbus.
# A gripper's function takes (port, pace, report, *, read_only), an arm's (host, number, pace, setup).
GRIPPERS = {
    TTY: "drivers.connect:robotiq_gripper",
    "rtu+tcp": "drivers.connect:robotiq_gripper",
    "tcp": "drivers.connect:robotiq_gripper",
    "can": "drivers.robotiq.canopen:gripper",
}
ARMS = {"tcp": "drivers.abb.arm:connect"}


def gripper(
    port: str,
    *,
    time_scale: float = 1.0,
    read_only: bool = False,
    report: Report = no_report,
) -> "Gripper":
    """Open a gripper; reads its state, writes nothing.

    Args:
        port: see above.
        time_scale: device seconds per wall second; 1 for hardware.
        read_only: give it a link that cannot write.
        report: told of every retry and failure on the link, as (kind, fields): a journal's `record` fits.

    Raises:
        PortError: the port cannot be opened.
        LinkError: nothing answers there.
    """
    pace = Pace(WallClock(), time_scale)
    opened: Gripper = _opener(GRIPPERS, port)(port, pace, report, read_only=read_only)
    return opened


def robotiq_gripper(port: str, pace: Pace, report: Report, *, read_only: bool) -> "Gripper":
    """A Robotiq 2F on a tty, behind a serial device server, or with Modbus TCP."""
    from drivers.robotiq.gripper import over

    return over(_modbus_link(port, pace, report), pace, report, read_only=read_only)


def _modbus_link(port: str, pace: Pace, report: Report) -> "ModbusLink":
    from drivers.robotiq import modbus

    if "://" not in port:
        return modbus.open_serial(port, pace, report)
    scheme, host, number = _address(port)
    return modbus.open_tcp_link(host, number, pace, rtu=scheme == "rtu+tcp", report=report)


def scan(port: str) -> "Iterator[Answered]":
    """Who answers on a serial port, at which baud rate; reads only.

    Raises:
        PortError: the port cannot be opened.
    """
    from drivers.robotiq import modbus

    return modbus.scan(port)


def arm(url: str, *, time_scale: float = 1.0, read_only: bool = False) -> "Arm":
    """Connect to an arm (open_abb server); sends its settings, moves nothing.

    Args:
        url: `tcp://host:port`; frames and limits (`drivers.abb.reach.Setup`) may follow as
            `?tool=x,y,z&work_object=...&base=...` (mm, and a quaternion after them if it is not the unit),
            `&area=` with six numbers in mm, and `&wrist=` with the least and greatest angle of the last axis
            in degrees.
        time_scale: arm seconds per wall second; 1 for hardware.
        read_only: send no setting, refuse every motion.

    Raises:
        PortError: nobody accepts the connection, or the address is not understood.
        ArmError: whoever answers is no open_abb server.
    """
    from drivers.abb.reach import Setup

    plain, _, query = url.partition("?")
    setup = Setup(**_settings(url, query), read_only=read_only)
    open_arm = _opener(ARMS, plain)
    _, host, number = _address(plain)
    opened: Arm = open_arm(host, number, Pace(WallClock(), time_scale), setup)
    return opened


def scene(url: str) -> "Scene":
    """Connect to the scene of a simulated cell: its feeder and the ground truth.

    Raises:
        PortError: nobody accepts the connection.
    """
    from drivers.sim.physics.scene_protocol import Scene

    if not url.startswith("tcp://"):
        raise _not_understood(url, ["tcp"])
    _, host, number = _address(url)
    return Scene(host, number)


def _opener(makes: dict[str, str], port: str) -> Callable[..., Any]:
    """The function that opens a port, by its scheme."""
    scheme = "can" if port.startswith("can:") else port.partition("://")[0] if "://" in port else TTY
    if scheme not in makes:
        raise _not_understood(port, list(makes))
    module, _, function = makes[scheme].partition(":")
    opener: Callable[..., Any] = getattr(import_module(module), function)
    return opener


def _address(url: str) -> tuple[str, str, int]:
    """Split `scheme://host:port`."""
    try:
        parts = urlsplit(url)
        number = parts.port or 0
    except ValueError as error:
        raise _not_understood(url, ["tcp"]) from error
    if not (parts.hostname and number) or parts.path or parts.query:
        raise _not_understood(url, [parts.scheme])
    return parts.scheme, parts.hostname, number


def _not_understood(url: str, schemes: list[str]) -> PortError:
    written = " or ".join(f"{scheme}://host:port" for scheme in schemes if scheme not in (TTY, "can"))
    return PortError(f"port {url} is not understood; write it as {written}", url)


def _settings(url: str, query: str) -> dict[str, Any]:
    """Frames and limits from an arm's address."""
    from drivers.abb.codec import IDENTITY, Pose

    settings: dict[str, Any] = {}
    for name, text in parse_qsl(query, keep_blank_values=True):
        try:
            numbers = [float(number) for number in text.split(",")]
        except ValueError:
            numbers = []
        if name in {"tool", "work_object", "base"} and len(numbers) in {3, 7}:
            rotation = tuple(numbers[3:]) or IDENTITY.rotation
            settings[name] = Pose(numbers[0], numbers[1], numbers[2], rotation)  # type: ignore[arg-type]
        elif (name, len(numbers)) == ("area", 6) or (name == "wrist" and len(numbers) == 2):
            settings[name] = tuple(numbers)
        else:
            raise PortError(
                f"arm {url}: {name}={text} is not understood; tool, work_object and base take x,y,z in mm "
                "(and a quaternion w,x,y,z), area takes x,y,z,x,y,z, wrist the last axis's range in degrees",
                url,
            )
    return settings
