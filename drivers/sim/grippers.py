"""The grippers that can be simulated: by model, its device and the ports that it is served on."""

import random
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from drivers.clock import Pace
from drivers.dh import registers as dh
from drivers.dh.gripper import Gripper as DhGripper
from drivers.dh.link import RtuLink
from drivers.ports import Gripper, GripperProfile, Report
from drivers.robotiq.frames import TCP
from drivers.robotiq.gripper import Gripper as RobotiqGripper
from drivers.robotiq.modbus import rtu_link
from drivers.schunk import gripper as schunk_driver
from drivers.schunk import registers as schunk
from drivers.sim.devices.dh import DhModel, DhRegisters, FaultyDhModel
from drivers.sim.devices.faulty import FaultyGripper
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.gripper_tcp import MbapSlave, TcpPort, stop_jaws
from drivers.sim.devices.gripper_urcap import Urcap, UrcapPort
from drivers.sim.devices.jaws import Jaws, Surroundings
from drivers.sim.devices.schunk import SchunkModel
from drivers.sim.devices.schunk_faulty import FaultySchunkModel
from drivers.sim.devices.schunk_registers import SchunkRegisters
from drivers.sim.faults import Desk
from drivers.sim.wire.line import CleanLine
from drivers.sim.wire.modbus import GripperRegisters
from drivers.sim.wire.rtu import PtyPort, RtuSlave
from drivers.sim.wire.serving import Lock, Server, SimulatedTime
from drivers.stream import Stream
from runtime.shell.errors import UsageError
from runtime.table import same_model


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
    path: str  # of the serial port
    port: str  # the same as `drivers.connect` takes it
    others: Mapping[str, str] = MappingProxyType({})


class Simulator(NamedTuple):
    """How one model is simulated."""

    device: Callable[[Mount], Any]  # a SimulatedGripper
    slave: Callable[[Any, Callable[[], float], CleanLine], RtuSlave]  # the device on a serial line
    ports: Callable[[Any, Bench], Ports]
    driver: Callable[[Stream, Pace, Report, GripperProfile], Gripper]  # on that serial line


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
    others = {
        "gripper_tcp": tcp.url,
        "gripper_rtu_tcp": f"rtu+{rtu_tcp.url}",
        "gripper_urcap": urcap.url,
    }
    return Ports([pty, rtu_tcp, tcp, urcap], pty.path, pty.path, others)


def _robotiq_driver(stream: Stream, pace: Pace, report: Report, profile: GripperProfile) -> Gripper:
    return RobotiqGripper(rtu_link(stream, pace, report), pace, report, profile)


def _dh_device(mount: Mount) -> DhModel:
    if mount.desk is not None:
        return FaultyDhModel(mount.rng, mount.surroundings, mount.profile, mount.desk)
    return DhModel(mount.rng, mount.surroundings, mount.profile)


def _dh_slave(device: DhModel, now: Callable[[], float], line: CleanLine) -> RtuSlave:
    return RtuSlave(DhRegisters(device, now), line, dh.UNIT)


def _dh_ports(device: DhModel, bench: Bench) -> Ports:
    slave = _dh_slave(device, bench.time.now, bench.line())
    pty = PtyPort(slave, bench.lock, bench.time)
    return Ports([pty], pty.path, f"dh://{pty.path}")


def _dh_driver(stream: Stream, pace: Pace, report: Report, profile: GripperProfile) -> Gripper:
    return DhGripper(RtuLink(stream, pace, report), pace, report, profile)


def _schunk_device(mount: Mount) -> SchunkModel:
    if mount.desk is not None:
        return FaultySchunkModel(mount.rng, mount.surroundings, mount.profile, mount.desk)
    return SchunkModel(mount.rng, mount.surroundings, mount.profile)


def _schunk_slave(device: SchunkModel, now: Callable[[], float], line: CleanLine) -> RtuSlave:
    return RtuSlave(SchunkRegisters(device, now), line, schunk.UNIT)


def _schunk_ports(device: SchunkModel, bench: Bench) -> Ports:
    slave = _schunk_slave(device, bench.time.now, bench.line())
    pty = PtyPort(slave, bench.lock, bench.time)
    return Ports([pty], pty.path, f"schunk://{pty.path}")


ROBOTIQ = Simulator(_robotiq_device, _robotiq_slave, _robotiq_ports, _robotiq_driver)
DH = Simulator(_dh_device, _dh_slave, _dh_ports, _dh_driver)
SCHUNK = Simulator(_schunk_device, _schunk_slave, _schunk_ports, schunk_driver.over)
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
    """How a model is simulated, however its name is written; UsageError where nobody knows."""
    for name, result in SIMULATORS.items():
        if same_model(name, model):
            return result
    known = ", ".join(SIMULATORS)
    raise UsageError(f"there is no simulated gripper {model}; there are {known}")
