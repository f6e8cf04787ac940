"""Grippers of every make and on every bus, simulated, and something between their fingers.

A new make is one more class here with `open`, `contact`, `commands` and `silence`, and one more name in
`RIGS`.
"""

import contextlib
import random
import threading

from can_node import CanNode

from drivers import connect
from drivers.dh import registers as dh
from drivers.robotiq.canopen import CanMap
from drivers.robotiq.frames import TCP
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.devices.gripper_tcp import MbapSlave, TcpPort, stop_jaws
from drivers.sim.devices.gripper_urcap import Urcap, UrcapPort
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.wire.rtu import PtyPort, RtuSlave
from drivers.sim.wire.serving import SimulatedTime
from runtime.table import profile_of

SCALE = 20.0


class GripperRig(Surroundings):
    """A simulated gripper and what is between its fingers; a subclass makes `name`, `port` and a slave."""

    profile, scale = None, SCALE
    holds = False

    def closing(self):
        return self.contact_um / 1000 if self.holds else None

    def open(self, **options):
        opened = connect.gripper(self.name, self.profile, time_scale=self.scale, **options)
        return contextlib.closing(opened)

    def put_part(self):
        self.holds = True

    def silence(self):
        """From now on nothing is answered."""
        self.slave.feed = lambda data: []

    def close(self):
        self.port.close()


class Robotiq(GripperRig):
    """A simulated 2F gripper on some port."""

    contact_um = 20969  # count 174

    def __init__(self, bus: str) -> None:
        self.time = SimulatedTime(SCALE, threading.Event())
        self.now = self.time.now
        self.lock = threading.RLock()
        self.model = GripperModel(random.Random(1), self)
        self.port, self.name = self._port(bus)
        self.port.start()

    def _port(self, bus: str):
        if bus == "pty":
            self.slave = RtuSlave(GripperRegisters(self.model, self.now))
            port = PtyPort(self.slave, self.lock, self.time)
            return port, port.path
        if bus == "can":
            node = CanNode(self.model, self.lock, self.now, CanMap("contract", "virtual"))
            return node, "can:contract?interface=virtual"
        if bus.startswith("urcap"):
            ends = b"" if bus.endswith("bare") else b"\n"
            port = UrcapPort(Urcap(self.model, self.now, ends), self.lock)
            return port, port.url
        if bus == "rtu+tcp":
            self.slave, left = RtuSlave(GripperRegisters(self.model, self.now)), ()
        else:
            self.slave = MbapSlave(GripperRegisters(self.model, self.now, TCP))
            left = (lambda: stop_jaws(self.model, self.now),)
        port = TcpPort(self.slave, self.lock, self.time, *left)
        return port, f"{bus}://127.0.0.1:{port.port}"

    def commanded(self):
        """Whether anything was ever written to it."""
        return self.commands() != bytes(16)

    def commands(self):
        """What differs after a command."""
        return bytes(self.model.read_output())

    def silence(self):
        if hasattr(self, "slave"):
            super().silence()
        elif hasattr(self.port, "urcap"):
            self.port.urcap.answer = lambda line: None
        else:
            self.port.close()


RIGS = {bus: lambda bus=bus: Robotiq(bus) for bus in ("pty", "tcp", "urcap", "can")}


class Dh(GripperRig):
    """A simulated DH gripper on a pseudo-terminal."""

    def __init__(self, model: str = "dh-ag95", scale: float = SCALE) -> None:
        self.profile, self.scale = profile_of(model), scale
        self.contact_um = self.profile.reading_um(321)
        time = SimulatedTime(scale, threading.Event())
        self.now = time.now
        self.device = DhModel(random.Random(1), self, self.profile)
        self.slave = RtuSlave(DhRegisters(self.device, time.now), None, dh.UNIT)
        self.lock = threading.RLock()
        self.port = PtyPort(self.slave, self.lock, time)
        self.name = f"dh://{self.port.path}"
        self.port.start()

    def commanded(self):
        """Whether anything was ever written to it."""
        return self.commands() != 0

    def commands(self):
        """What differs after a command."""
        return self.device.writes


RIGS |= {"dh-ag95": lambda: Dh(scale=80.0)}  # its slowest closing takes 50 s
