"""Opens a device by its port name: the only module that a runtime needs from this package.

Ports of grippers:

- a tty path: a Robotiq gripper over Modbus RTU, 115200 8N1, slave 9
- `rtu+tcp://host:port`: the same RTU frames over a raw TCP port
- `tcp://host:port`: Modbus TCP, unit 2; settings such as `?unit=9` change this (`drivers.robotiq.modbus`)
- `urcap://host`: the text socket of Robotiq's URCap on a UR controller
- `can:channel`: CANopen (`drivers.robotiq.canopen`)
- `dh:///dev/...`: DH-Robotics (drivers/dh/README.md)
- `schunk:///dev/...`: SCHUNK (drivers/schunk/README.md)
- `manual`: a person types widths

Ports of arms. Frames and limits follow the address after a `?`, except for `manual`, as in
`tcp://192.168.125.1:5000?tool=0,0,150&base=-300,0,0`:

- `tcp://host:port`: open_abb
- `ur://host`: a UR controller
- `omnicore://host`: Robot Web Services 2
- `manual`: a person moves the hand; with `manual+tcp://...` a simulated arm follows

The port of a simulated scene is `tcp://host:port`.

A device of another make needs one more line in `GRIPPERS` or `ARMS`, or a separate package with an entry
point for its scheme and the function that opens it (tools/docs/drivers.md).
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

from drivers.clock import Clock, Pace
from drivers.errors import PortError
from drivers.ports import Answered, Arm, Gripper, GripperProfile, Report, Scene, no_report
from runtime.shell.errors import ExpectedError

TTY = "tty"  # the scheme of a port without one
MANUAL = "manual"  # the scheme of a person, which needs no host


class Makes(NamedTuple):
    """The functions that open devices of one kind (grippers or arms), by the scheme of the port's name."""

    group: str  # group of entry points by which other packages add schemes
    kind: type  # the Protocol of opened devices
    known: dict[str, str]  # scheme -> module:function, imported when the scheme is first used


# A gripper's function takes (port, pace, report, *, read_only, profile), an arm's (url, pace, *, read_only).
GRIPPERS = Makes(
    "squeezetree.grippers",
    Gripper,
    {
        **dict.fromkeys((TTY, "rtu+tcp", "tcp"), "drivers.robotiq.modbus:gripper"),
        "urcap": "drivers.robotiq.urcap:gripper",
        "can": "drivers.robotiq.canopen:gripper",
        "dh": "drivers.dh.gripper:gripper",
        "schunk": "drivers.schunk.gripper:gripper",
        MANUAL: "drivers.manual:gripper",
    },
)
ARMS = Makes(
    "squeezetree.arms",
    Arm,
    {
        "tcp": "drivers.abb.arm:connect",
        "omnicore": "drivers.abb.omnicore:connect",
        "ur": "drivers.ur.arm:connect",
        MANUAL: "drivers.connect:manual_arm",
    },
)


def gripper(
    port: str,
    profile: GripperProfile | None = None,
    *,
    time_scale: float = 1.0,
    read_only: bool = False,
    report: Report = no_report,
) -> Gripper:
    """Opens a gripper and reads its state; writes nothing.

    Args:
        port: address of the gripper.
        profile: profile of the expected gripper; None: the usual profile of the make.
        time_scale: device seconds per wall second.
        read_only: whether the link refuses to write.
        report: receives every retry and failure on the link.

    Raises:
        PortError: port or driver cannot be opened, or the gripper is of another model than the profile.
        LinkError: nothing answers.
    """
    options = {"read_only": read_only, "profile": profile}
    opened: Gripper = _opened(GRIPPERS, port, Pace(Clock(), time_scale), report, **options)
    if profile is not None and opened.profile.model != profile.model:
        opened.close()
        raise PortError(
            f"the gripper at {port} is a {opened.profile.model}, not a {profile.model}; correct the model, "
            "or the port"
        )
    return opened


def scan(port: str) -> Iterator[Answered]:
    """Yields slave id and baud rate of each Modbus device that answers on a serial port; reads only.

    Asks only with the settings that a Robotiq gripper may have (`drivers.robotiq.modbus.scan`).

    Raises:
        PortError: the port cannot be opened.
        LinkError: the port accepts no bytes, or is gone.
    """
    from drivers.robotiq import modbus

    return modbus.scan(port)


def arm(url: str, *, time_scale: float = 1.0, read_only: bool = False) -> Arm:
    """Connects to an arm; moves nothing, but may send settings.

    Frames and limits may follow the address (drivers/abb/README.md). With `read_only` no setting is sent, and
    every motion is refused.

    Raises:
        PortError: the connection is refused, the address is invalid, or the driver cannot be loaded.
        ArmError: the other side is not such an arm.
    """
    opened: Arm = _opened(ARMS, url, Pace(Clock(), time_scale), read_only=read_only)
    return opened


def manual_arm(url: str, pace: Pace, *, read_only: bool) -> Arm:
    """Opens an arm whose motions a person carries out, and the simulated arm that repeats them, if any.

    Raises:
        PortError: the address is not understood, or the simulated arm cannot be opened.
    """
    from drivers.manual import ManualArm

    behind = url.removeprefix(MANUAL).removeprefix("+")
    if url not in (MANUAL, f"{MANUAL}+{behind}"):
        raise PortError(f"arm {url} is not understood; write {MANUAL}")
    followed = arm(behind, time_scale=pace.time_scale, read_only=read_only) if behind else None
    return ManualArm(followed, read_only=read_only)


def scene(url: str) -> Scene:
    """Connects to the scene of a simulated cell: its feeder and the ground truth.

    Raises:
        PortError: the connection is refused.
    """
    from drivers.sim.physics import scene_protocol
    from drivers.stream import tcp_address

    return scene_protocol.Scene(*tcp_address(url))


class VirtualDevices(NamedTuple):
    """The devices of a simulated cell in this process, and its clock, which advances only during waits."""

    gripper: Gripper
    arm: Arm
    scene: Scene
    clock: Clock


def virtual(tree: Path, *, world: str, seed: int, report: Report = no_report) -> VirtualDevices:
    """Creates a simulated cell for a decision table, and connects to its devices.

    Args:
        tree: file of the decision table.
        world: physics of the squeezes, `module:factory`.
        seed: seed of all random numbers.
        report: receives every retry and failure on the gripper's link.

    Raises:
        UsageError: the world cannot be loaded, or fails.
        InputError: the table cannot be read.
    """
    from drivers.sim.physics.scene import load, warm_up
    from drivers.sim.virtual.cell import VirtualCell

    setting = load(tree, None, world)
    warm_up(setting, seed)
    cell = VirtualCell(setting, seed)
    return VirtualDevices(cell.gripper(report), cell.arm(), cell.scene, cell.clock)


def _opened(makes: Makes, port: str, *settings: object, **options: object) -> Any:
    scheme = port.partition(":")[0].partition("+")[0]
    if scheme not in ("can", MANUAL):
        scheme = port.partition("://")[0] if "://" in port else TTY
    if scheme in makes.known:
        return resolve_name(makes.known[scheme])(port, *settings, **options)
    return _plugged_in(makes, scheme, port, *settings, **options)


def _plugged_in(makes: Makes, scheme: str, port: str, *settings: object, **options: object) -> Any:
    """Opens a device with the driver of another package.

    An unexpected error of the driver becomes a PortError that names the driver.
    """
    name, open_device = _plug_in(makes, scheme, port)
    try:
        device = open_device(port, *settings, **options)
    except Exception as error:
        if isinstance(error, ExpectedError):
            raise
        raise PortError(f"{name} failed to open {port}: {type(error).__name__}: {error}") from error
    if not isinstance(device, makes.kind):
        raise PortError(
            f"{name} opened no {makes.kind.__name__} (drivers/ports.py): {type(device).__name__}"
        )
    return device


def _plug_in(makes: Makes, scheme: str, port: str) -> tuple[str, Callable[..., Any]]:
    from importlib.metadata import entry_points  # only for a scheme of other packages

    points = entry_points(group=makes.group)
    named = {point.dist and point.dist.name: point for point in points.select(name=scheme)}
    if not named:
        schemes = {*makes.known, *points.names} - {TTY, "can", MANUAL}
        written = " or ".join(f"{one}://host:port" for one in sorted(schemes))
        raise PortError(
            f"port {port} is not understood; write it as {written}, or install its driver"
        )
    if len(named) > 1:
        packages = " and ".join(sorted(map(str, named)))
        raise PortError(
            f"port {port}: {packages} both have a driver for {scheme}://; uninstall one of them"
        )
    [(package, point)] = named.items()
    name = f"the driver of {scheme}:// ({package}, {point.value})"
    try:
        return name, point.load()
    except Exception as error:
        raise PortError(
            f"{name} cannot be loaded: {type(error).__name__}: {error}; reinstall {package}"
        ) from error
