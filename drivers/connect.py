"""Open a device by its port name: the one module a runtime needs from this package.

Gripper ports: a tty path (Modbus RTU, 115200 8N1, slave 9), `rtu+tcp://host:port` (RTU frames over a raw TCP
port), `tcp://host:port` (Modbus TCP). Arms and simulated scenes: `tcp://host:port`.
"""

from typing import TYPE_CHECKING

from drivers.clock import Clock, Pace, WallClock
from drivers.errors import PortError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.abb.arm import Arm
    from drivers.abb.codec import Pose
    from drivers.robotiq.gripper import Gripper
    from drivers.robotiq.probe import Answered
    from drivers.sim.eye import Scene


def gripper(
    port: str, *, clock: Clock | None = None, time_scale: float = 1.0, read_only: bool = False
) -> "Gripper":
    """Open a gripper; reads its state, writes nothing.

    Args:
        port: see above.
        clock: clock of waits and deadlines, in wall seconds; none: the machine's own.
        time_scale: device seconds per wall second; 1 for hardware.
        read_only: give it a link that cannot write.

    Raises:
        PortError: the port cannot be opened.
        LinkError: nothing answers there.
    """
    # Imported here: a program that opens no gripper does not load pymodbus.
    from drivers.robotiq import modbus
    from drivers.robotiq.gripper import Gripper
    from drivers.robotiq.readonly import ReadOnlyLink

    pace = Pace(clock or WallClock(), time_scale)
    if port.startswith("can:"):
        raise PortError(f"port {port}: CANopen is not built yet; use a tty, rtu+tcp:// or tcp://", port)
    if "://" not in port:
        link = modbus.open_serial(port, pace)
    else:
        scheme, host, number = _address(port, ("rtu+tcp", "tcp"))
        link = modbus.open_tcp(host, number, pace, rtu=scheme == "rtu+tcp")
    try:
        return Gripper(ReadOnlyLink(link) if read_only else link, pace)
    except BaseException:
        link.close()
        raise


def scan(port: str) -> "Iterator[Answered]":
    """Who answers on a serial port, at which baud rate; reads only.

    Raises:
        PortError: the port cannot be opened.
    """
    from drivers.robotiq import probe

    return probe.scan(port)


def arm(
    url: str,
    *,
    clock: Clock | None = None,
    time_scale: float = 1.0,
    tool: "Pose | None" = None,
    work_object: "Pose | None" = None,
    read_only: bool = False,
) -> "Arm":
    """Connect to an arm (open_abb server); sends its settings, moves nothing.

    Args:
        url: `tcp://host:port`.
        clock: clock of waits and deadlines, in wall seconds; none: the machine's own.
        time_scale: arm seconds per wall second; 1 for hardware.
        tool: tool frame; none: the flange itself.
        work_object: work object frame; none: the arm's world frame.
        read_only: send no setting, refuse every motion.

    Raises:
        PortError: nobody accepts the connection.
        ArmError: whoever answers is no open_abb server.
    """
    from drivers.abb.arm import connect
    from drivers.abb.codec import IDENTITY

    _, host, number = _address(url, ("tcp",))
    return connect(
        host,
        number,
        Pace(clock or WallClock(), time_scale),
        tool or IDENTITY,
        work_object or IDENTITY,
        read_only=read_only,
    )


def scene(url: str) -> "Scene":
    """Connect to the scene of a simulated cell: its feeder, and the eye that knows the truth.

    Raises:
        PortError: nobody accepts the connection.
    """
    from drivers.sim.eye import Scene

    _, host, number = _address(url, ("tcp",))
    return Scene(host, number)


def _address(url: str, schemes: tuple[str, ...]) -> tuple[str, str, int]:
    """Split `scheme://host:port`."""
    scheme, separator, rest = url.partition("://")
    host, colon, number = rest.rpartition(":")
    valid = separator and colon and scheme in schemes and host and number.isdecimal()
    if not valid or not 0 < int(number) < 65536:
        raise PortError(f"port {url} is not understood; write it as {schemes[0]}://host:port", url)
    return scheme, host.strip("[]"), int(number)
