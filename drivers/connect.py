"""Open a device by its port name: the one module a runtime needs from this package.

Gripper ports: a tty path (Modbus RTU, 115200 8N1, slave 9), `rtu+tcp://host:port` (RTU frames over a raw TCP
port), `tcp://host:port` (Modbus TCP), `can:channel` (CANopen, see `drivers.robotiq.canopen`). Arms:
`tcp://host:port`, with frames and limits after a `?`:
`tcp://192.168.125.1:5000?tool=0,0,150&base=-300,0,0`. Simulated scenes: `tcp://host:port`.

A device of another make is one more line in `GRIPPERS` or `ARMS`: a scheme, and the function that opens it.
"""

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from drivers.clock import Clock, Pace
from drivers.errors import PortError
from drivers.ports import Answered, Arm, Gripper, Report, Scene
from drivers.robotiq.link import no_report

TTY = "tty"  # the scheme of a port without one

# Scheme -> module:function. Imported when first used: a program that opens no gripper loads no pymodbus.
# A gripper's function takes (port, pace, report, *, read_only), an arm's (host, number, pace, setup).
GRIPPERS = dict.fromkeys((TTY, "rtu+tcp", "tcp"), "drivers.connect:robotiq_gripper")
GRIPPERS["can"] = "drivers.robotiq.canopen:gripper"
ARMS = {"tcp": "drivers.abb.arm:connect"}


def gripper(
    port: str, *, time_scale: float = 1.0, read_only: bool = False, report: Report = no_report
) -> Gripper:
    """Open a gripper; reads its state, writes nothing.

    With `read_only` it has a link that cannot write; `report` is told of every retry and failure on it.

    Raises:
        PortError: the port cannot be opened.
        LinkError: nothing answers there.
    """
    opened: Gripper = _opener(GRIPPERS, port)(port, Pace(Clock(), time_scale), report, read_only=read_only)
    return opened


def robotiq_gripper(port: str, pace: Pace, report: Report, *, read_only: bool) -> Gripper:
    """A Robotiq 2F on a tty, behind a serial device server, or with Modbus TCP."""
    from drivers.robotiq import modbus
    from drivers.robotiq.gripper import over
    from drivers.stream import SerialStream, Stream, open_tcp

    stream: Stream
    open_link = modbus.rtu_link
    if "://" in port:
        scheme, host, number = _address(port)
        stream = open_tcp(host, number, port, "check address, cable and power")
        if scheme == "tcp":
            open_link = modbus.tcp_link
    else:
        stream = SerialStream(port, modbus.BAUD)
    return over(open_link(stream, pace, report), pace, report, read_only=read_only)


def scan(port: str) -> Iterator[Answered]:
    """Who answers on a serial port, at which baud rate; reads only.

    Raises:
        PortError: the port cannot be opened.
    """
    from drivers.robotiq import modbus

    return modbus.scan(port)


def arm(url: str, *, time_scale: float = 1.0, read_only: bool = False) -> Arm:
    """Connect to an arm (open_abb server); sends its settings, moves nothing.

    Frames and limits may follow its address (drivers/abb/README.md). With `read_only` no setting is sent, and
    every motion refused.

    Raises:
        PortError: nobody accepts the connection, or the address is not understood.
        ArmError: whoever answers is no open_abb server.
    """
    from drivers.abb.reach import Setup

    plain, _, query = url.partition("?")
    setup = Setup(**_settings(url, query), read_only=read_only)
    open_arm = _opener(ARMS, plain)
    _, host, number = _address(plain)
    opened: Arm = open_arm(host, number, Pace(Clock(), time_scale), setup)
    return opened


def scene(url: str) -> Scene:
    """Connect to the scene of a simulated cell: its feeder and the ground truth.

    Raises:
        PortError: nobody accepts the connection.
    """
    from drivers.sim.physics import scene_protocol

    _, host, number = _address(url)
    return scene_protocol.Scene(host, number)


def _opener(makes: dict[str, str], port: str) -> Callable[..., Any]:
    scheme = "can" if port.startswith("can:") else port.partition("://")[0] if "://" in port else TTY
    if scheme not in makes:
        raise _not_understood(port, list(makes))
    module, _, function = makes[scheme].partition(":")
    opener: Callable[..., Any] = getattr(import_module(module), function)
    return opener


def _address(url: str) -> tuple[str, str, int]:
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
    return PortError(f"port {url} is not understood; write it as {written}")


def _settings(url: str, query: str) -> dict[str, Any]:
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
        elif (name, len(numbers)) in {("area", 6), ("wrist", 2)}:
            settings[name] = tuple(numbers)
        else:
            raise PortError(
                f"arm {url}: {name}={text} is not understood; tool, work_object and base take x,y,z in mm "
                "(and a quaternion w,x,y,z), area takes x,y,z,x,y,z, wrist the last axis's range in degrees"
            )
    return settings
