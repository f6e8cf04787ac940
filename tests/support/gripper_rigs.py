"""Grippers of every make and on every bus, simulated, and something between their fingers.

A new make is one more class here with `open`, `contact`, `commands` and `silence`, and one more name in
`RIGS`.
"""

import contextlib
import random

from can_node import CanNode

from drivers import connect
from drivers.dh import registers as dh
from drivers.robotiq.canopen import CanMap
from drivers.robotiq.frames import TCP
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.devices.gripper_tcp import MbapSlave, open_port, stop_jaws
from drivers.sim.devices.gripper_urcap import MAX_LINE, Urcap
from drivers.sim.wire.rtu import PtyPort, RtuSlave
from drivers.sim.wire.serving import Site
from runtime.table import profile_of

SCALE = 20.0


class Robotiq:
    """A simulated 2F gripper on some port."""

    contact_um = 20969  # count 174

    def __init__(self, bus: str, channel: str = "contract") -> None:
        self.site = Site(SCALE)
        self.now = self.site.now
        self.holds, self.mute = False, False
        self.model = GripperModel(random.Random(1), self)
        self.node = None
        self.name = self._opened(bus, channel)

    def _opened(self, bus: str, channel: str) -> str:
        """Opens the port; returns its name for the driver."""
        if bus == "can":
            self.node = CanNode(self.model, self.now, CanMap(channel, "virtual"))
            return f"can:{channel}?interface=virtual"
        if bus.startswith("urcap"):
            urcap = Urcap(self.model, self.now, b"" if bus.endswith("bare") else b"\n")
            port = self.site.answer_lines(
                lambda line: b"" if self.mute else urcap.answer(line), MAX_LINE
            )
            return f"urcap://127.0.0.1:{port}"
        if bus == "tcp":
            self.slave = MbapSlave(GripperRegisters(self.model, self.now, TCP), unit=TCP.unit)
            port = open_port(self.slave, self.site, lambda: stop_jaws(self.model, self.now))
            return f"tcp://127.0.0.1:{port}"
        self.slave = RtuSlave(GripperRegisters(self.model, self.now))
        if bus == "pty":
            return PtyPort(self.slave, self.site).path
        return f"{bus}://127.0.0.1:{open_port(self.slave, self.site)}"

    # what the fingers meet: drivers.sim.devices.jaws.Surroundings
    def closing(self):
        return self.contact_um / 1000 if self.holds else None

    def gripped(self):
        pass

    def released(self):
        pass

    def open(self, **options):
        return contextlib.closing(connect.gripper(self.name, time_scale=SCALE, **options))

    def put_part(self):
        self.holds = True

    def commanded(self):
        """Whether anything was ever written to it."""
        return self.commands() != bytes(16)

    def commands(self):
        """What differs after a command."""
        return bytes(self.model.read_output())

    def silence(self):
        """From now on nothing is answered."""
        self.mute = True
        if hasattr(self, "slave"):
            self.slave.feed = lambda data: []
        elif self.node is not None:
            self.node.close()

    def close(self):
        if self.node is not None:
            self.node.close()
        self.site.close()


RIGS = {bus: lambda bus=bus: Robotiq(bus) for bus in ("pty", "tcp", "urcap", "can")}


class Dh:
    """A simulated DH gripper on a pseudo-terminal."""

    def __init__(self, model: str = "dh-ag95", scale: float = SCALE, line=None) -> None:
        self.profile, self.scale = profile_of(model), scale
        self.contact_um = self.profile.reading_um(321)
        self.holds = False
        self.site = Site(scale)
        self.now = self.site.now
        self.device = DhModel(random.Random(1), self, self.profile)
        self.slave = RtuSlave(DhRegisters(self.device, self.now), line, dh.UNIT)
        self.path = PtyPort(self.slave, self.site).path
        self.name = f"dh://{self.path}"

    # what the fingers meet: drivers.sim.devices.jaws.Surroundings
    def closing(self):
        return self.contact_um / 1000 if self.holds else None

    def gripped(self):
        pass

    def released(self):
        pass

    def open(self, **options):
        return contextlib.closing(
            connect.gripper(self.name, self.profile, time_scale=self.scale, **options)
        )

    def put_part(self):
        self.holds = True

    def commanded(self):
        """Whether anything was ever written to it."""
        return self.commands() != 0

    def commands(self):
        """What differs after a command."""
        return self.device.writes

    def silence(self):
        """From now on nothing is answered."""
        self.slave.feed = lambda data: []

    def close(self):
        self.site.close()


RIGS |= {"dh-ag95": lambda: Dh(scale=80.0)}  # its slowest closing takes 50 s
