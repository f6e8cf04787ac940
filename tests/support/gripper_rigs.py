"""Simulated grippers of every make and on every bus, which may close on a part.

A new make needs a class here with `open`, `put_part`, `commands` and `silence`, and a name in `RIGS`.
"""

import contextlib
import random

from can_node import CanNode

from drivers import connect
from drivers.dh import registers as dh
from drivers.robotiq.canopen import CanMap
from drivers.robotiq.modbus import TCP
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.devices.gripper_urcap import MAX_LINE, Urcap
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.wire.rtu import MbapSlave, RtuSlave, open_port, open_pty
from drivers.sim.wire.serving import Site
from runtime.table import profile_of

SCALE = 20.0


class GripperRig(Surroundings):
    """A simulated gripper with a part or nothing between its fingers.

    A subclass sets `name`, the gripper's address; `site`, the event loop that serves the gripper; `slave`,
    which answers requests; and `contact_um`, the width of the part.
    """

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
        """Lets the gripper answer nothing from now on."""
        self.slave.feed = lambda data: []

    def close(self):
        self.site.close()


class Robotiq(GripperRig):
    """A simulated 2F gripper on a port of the bus `bus`."""

    contact_um = 20969  # count 174

    def __init__(self, bus: str) -> None:
        self.site = Site(SCALE)
        self.now = self.site.now
        self.mute, self.node = False, None
        self.model = GripperModel(random.Random(1), self)
        self.name = self._opened(bus)

    def _opened(self, bus: str) -> str:
        """Opens a port of the bus; returns the address for the driver."""
        if bus == "can":
            self.node = CanNode(self.model, self.now, CanMap("contract", "virtual"))
            return "can:contract?interface=virtual"
        if bus.startswith("urcap"):
            urcap = Urcap(self.model, self.now, b"" if bus.endswith("bare") else b"\n")
            answered = lambda line: b"" if self.mute else urcap.answer(line)  # noqa: E731
            port = self.site.answer_lines(answered, MAX_LINE)
            return f"urcap://127.0.0.1:{port}"
        if bus == "tcp":
            self.slave = MbapSlave(GripperRegisters(self.model, self.now, TCP), unit=TCP.unit)
            port = open_port(self.slave, self.site, lambda: self.model.hang_up(self.now()))
            return f"tcp://127.0.0.1:{port}"
        self.slave = RtuSlave(GripperRegisters(self.model, self.now))
        if bus == "pty":
            return open_pty(self.slave, self.site)
        return f"{bus}://127.0.0.1:{open_port(self.slave, self.site)}"

    def commanded(self):
        """Whether anything was ever written to the gripper."""
        return self.commands() != bytes(16)

    def commands(self):
        """Returns the gripper's output block, which differs after a command."""
        return bytes(self.model.read_output())

    def silence(self):
        self.mute = True
        if self.node is not None:
            self.node.close()
        elif hasattr(self, "slave"):
            super().silence()

    def close(self):
        if self.node is not None:
            self.node.close()
        super().close()


RIGS = {bus: lambda bus=bus: Robotiq(bus) for bus in ("pty", "tcp", "urcap", "can")}


class Dh(GripperRig):
    """A simulated DH gripper on a pseudo-terminal."""

    def __init__(self, model: str = "dh-ag95", scale: float = SCALE) -> None:
        self.profile, self.scale = profile_of(model), scale
        self.contact_um = self.profile.reading_um(321)
        self.site = Site(scale)
        self.now = self.site.now
        self.device = DhModel(random.Random(1), self, self.profile)
        self.slave = RtuSlave(DhRegisters(self.device, self.now), None, dh.UNIT)
        self.path = open_pty(self.slave, self.site)
        self.name = f"dh://{self.path}"

    def commanded(self):
        """Whether anything was ever written to the gripper."""
        return self.commands() != 0

    def commands(self):
        """Returns the number of registers written so far, which differs after a command."""
        return self.device.writes


RIGS |= {"dh-ag95": lambda: Dh(scale=80.0)}  # the slowest closing of this gripper takes 50 s
