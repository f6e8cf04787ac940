"""The grippers that can be simulated: by model, its device and the ports that it is served on."""

import random
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, Protocol

from drivers.dh import registers as dh
from drivers.robotiq.frames import TCP
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.faulty import FaultyGripper
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.devices.gripper_tcp import MbapSlave, TcpPort, stop_jaws
from drivers.sim.devices.gripper_urcap import Urcap, UrcapPort
from drivers.sim.devices.jaws import Jaws, Surroundings
from drivers.sim.faults import Desk
from drivers.sim.physics.scene import Geometry
from drivers.sim.wire.line import CleanLine
from drivers.sim.wire.modbus import GripperRegisters
from drivers.sim.wire.rtu import PtyPort, RtuSlave
from drivers.sim.wire.serving import Lock, Server, SimulatedTime


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

    rng: random.Random  # draws its lags
    surroundings: Surroundings  # what the fingers may meet
    geometry: Geometry | None = None  # of the job; None: as the maker has it
    desk: Desk | None = None  # says when the device fails; None: never


class Bench(NamedTuple):
    """What a gripper's ports are served with."""

    lock: Lock  # held while bytes are served
    time: SimulatedTime
    line: Callable[..., CleanLine]  # to the gripper; `checked=False`: its frames end in no CRC


class Ports(NamedTuple):
    """Where a gripper is served; a host uses one of them."""

    servers: list[Server]
    endpoints: dict[str, str]  # "gripper": of its serial port


class Simulator(NamedTuple):
    """How one model is simulated."""

    device: Callable[[Mount], Any]  # a SimulatedGripper
    slave: Callable[[Any, Callable[[], float], CleanLine], RtuSlave]  # the device on a serial line
    ports: Callable[[Any, Bench], Ports]


def _robotiq_device(mount: Mount) -> GripperModel:
    geometry, jaws = mount.geometry, Jaws()
    if geometry is not None:
        jaws = Jaws(geometry.opening_mm, geometry.count_open, geometry.count_closed)
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


def _dh(model: dh.Model) -> Simulator:
    def device(mount: Mount) -> DhModel:
        return DhModel(mount.rng, mount.surroundings, model)

    return Simulator(
        device, _dh_slave, partial(_serial_port, f"dh://{{}}?model={model.name}", _dh_slave)
    )


def _dh_slave(device: DhModel, now: Callable[[], float], line: CleanLine) -> RtuSlave:
    return RtuSlave(DhRegisters(device, now), line, dh.UNIT)


def _serial_port(
    port: str,
    slave: Callable[[Any, Callable[[], float], CleanLine], RtuSlave],
    device: Any,
    bench: Bench,
) -> Ports:
    """A serial line alone: its path, and `port` as `drivers.connect` wants that."""
    pty = PtyPort(slave(device, bench.time.now, bench.line()), bench.lock, bench.time)
    return Ports([pty], {"gripper": pty.path, "port": port.format(pty.path)})


USUAL = "robotiq-2f-85"
SIMULATORS = {
    USUAL: Simulator(_robotiq_device, _robotiq_slave, _robotiq_ports),
    **{name: _dh(model) for name, model in dh.MODELS.items()},
}
