"""The grippers that can be simulated: by model, its device and the ports that it is served on."""

import random
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from drivers.dh import registers as dh
from drivers.ports import GripperProfile
from drivers.robotiq.frames import TCP
from drivers.schunk import registers as schunk
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.faulty import FaultyGripper
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.gripper_tcp import MbapSlave, TcpPort, stop_jaws
from drivers.sim.devices.gripper_urcap import Urcap, UrcapPort
from drivers.sim.devices.jaws import Jaws, Surroundings
from drivers.sim.devices.schunk import SchunkModel, SchunkRegisters
from drivers.sim.faults import Desk
from drivers.sim.wire.line import CleanLine
from drivers.sim.wire.modbus import GripperRegisters
from drivers.sim.wire.rtu import PtyPort, RtuSlave
from drivers.sim.wire.serving import Lock, Server, SimulatedTime
from runtime.shell.errors import UsageError


class SimulatedGripper(Protocol):
    """A gripper's device, as a workcell drives it. Times are simulated seconds and never go back."""

    def opening_mm(self, now_s: float) -> float:
        """True distance between the fingers."""

    def advance(self, now_s: float) -> None:
        """Let time pass."""

    def next_change(self) -> float:
        """When the next reading will differ from the last, but for a moving width; infinity: never."""

    def lose_object(self, now_s: float) -> None:
        """What the fingers hold slips out."""


class Mount(NamedTuple):
    """What a gripper's device is made with."""

    profile: GripperProfile
    rng: random.Random  # draws its lags
    surroundings: Surroundings  # what the fingers may meet
    desk: Desk | None = None  # says when the device fails; None: never


class Bench(NamedTuple):
    """What a gripper's ports are served with."""

    lock: Lock  # held while bytes are served
    time: SimulatedTime
    line: Callable[..., CleanLine]  # to the gripper; `checked=False`: its frames end in no CRC


class Ports(NamedTuple):
    """Where a gripper is served; a host uses one of them."""

    servers: list[Server]
    endpoints: dict[str, str]  # "gripper": path of its serial port; "port": as a driver wants it


class Simulator(NamedTuple):
    """How one model is simulated."""

    device: Callable[[Mount], Any]  # a SimulatedGripper
    slave: Callable[[Any, Callable[[], float], CleanLine], RtuSlave]  # the device on a serial line
    ports: Callable[[Any, Bench], Ports]


def _robotiq_device(mount: Mount) -> GripperModel:
    jaws = Jaws.of(mount.profile)
    if mount.desk is not None:
        return FaultyGripper(mount.rng, jaws, mount.surroundings, mount.desk)
    return GripperModel(mount.rng, jaws, mount.surroundings)


def _robotiq_slave(device: GripperModel, now: Callable[[], float], line: CleanLine) -> RtuSlave:
    return RtuSlave(GripperRegisters(device, now), line)


def _robotiq_ports(device: GripperModel, bench: Bench) -> Ports:
    lock, time, now = bench.lock, bench.time, bench.time.now
    pty = PtyPort(_robotiq_slave(device, now, bench.line()), lock, time)
    rtu_tcp = TcpPort(_robotiq_slave(device, now, bench.line()), lock, time)
    slave = MbapSlave(GripperRegisters(device, now, TCP), bench.line(checked=False))
    tcp = TcpPort(slave, lock, time, lambda: stop_jaws(device, now))
    urcap = UrcapPort(Urcap(device, now), lock)
    endpoints = {
        "gripper": pty.path,
        "gripper_tcp": tcp.url,
        "gripper_rtu_tcp": f"rtu+{rtu_tcp.url}",
        "gripper_urcap": urcap.url,
    }
    return Ports([pty, rtu_tcp, tcp, urcap], endpoints)


def _dh_device(mount: Mount) -> DhModel:
    return DhModel(mount.rng, mount.surroundings, mount.profile)


def _dh_slave(device: DhModel, now: Callable[[], float], line: CleanLine) -> RtuSlave:
    return RtuSlave(DhRegisters(device, now), line, dh.UNIT)


def _dh_ports(device: DhModel, bench: Bench) -> Ports:
    slave = _dh_slave(device, bench.time.now, bench.line())
    pty = PtyPort(slave, bench.lock, bench.time)
    return Ports([pty], {"gripper": pty.path, "port": f"dh://{pty.path}"})


def _schunk_device(mount: Mount) -> SchunkModel:
    return SchunkModel(mount.rng, mount.surroundings, mount.profile)


def _schunk_slave(device: SchunkModel, now: Callable[[], float], line: CleanLine) -> RtuSlave:
    return RtuSlave(SchunkRegisters(device, now), line, schunk.UNIT)


def _schunk_ports(device: SchunkModel, bench: Bench) -> Ports:
    slave = _schunk_slave(device, bench.time.now, bench.line())
    pty = PtyPort(slave, bench.lock, bench.time)
    return Ports([pty], {"gripper": pty.path, "port": f"schunk://{pty.path}"})


ROBOTIQ = Simulator(_robotiq_device, _robotiq_slave, _robotiq_ports)
DH = Simulator(_dh_device, _dh_slave, _dh_ports)
SCHUNK = Simulator(_schunk_device, _schunk_slave, _schunk_ports)
SIMULATORS = {
    "robotiq-2f-85": ROBOTIQ,
    "robotiq-2f-140": ROBOTIQ,
    "hand-e": ROBOTIQ,
    "dh-ag95": DH,
    "dh-pgc140-50": DH,
    "schunk-egu": SCHUNK,
    "schunk-egk": SCHUNK,
}


def simulator(model: str) -> Simulator:
    """How a model is simulated; UsageError where nobody knows."""
    if model not in SIMULATORS:
        known = ", ".join(SIMULATORS)
        raise UsageError(f"there is no simulated gripper {model}; there are {known}")
    return SIMULATORS[model]
