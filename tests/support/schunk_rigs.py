"""Simulated SCHUNK grippers: on a pseudo-terminal, and in virtual time on a line that corrupts answers."""

import math
import random

from gripper_rigs import SCALE, GripperRig

from drivers.clock import Pace
from drivers.schunk.gripper import Gripper
from drivers.schunk.link import SchunkLink
from drivers.schunk.registers import UNIT
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.devices.schunk import SILENCE_S, SchunkModel, SchunkRegisters
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.virtual.ports import GripperPort
from drivers.sim.wire import line
from drivers.sim.wire.rtu import RtuSlave, open_pty
from drivers.sim.wire.serving import Site
from runtime.table import PROFILES


class Part(Surroundings):
    """A part between the fingers, or nothing if `width_mm` is None; counts grips and releases."""

    def __init__(self, width_mm=None):
        self.width_mm = width_mm
        self.asked = self.grips = self.releases = 0

    def closing(self):
        self.asked += 1
        return self.width_mm

    def gripped(self):
        self.grips += 1

    def released(self):
        self.releases += 1


class SchunkRig(GripperRig):
    """A simulated gripper on a pseudo-terminal.

    It accepts any pause between two requests, since a busy machine may send them late.
    """

    contact_um = 21_370

    def __init__(self, model="schunk-egu", scale=SCALE):
        self.scale = scale
        self.site = Site(scale)
        self.part = Part()
        profile = PROFILES[model]
        self.model = SchunkModel(random.Random(1), self.part, profile)
        self.model.silence_s = math.inf
        self.slave = RtuSlave(SchunkRegisters(self.model, self.site.now), None, UNIT)
        self.path = open_pty(self.slave, self.site)
        self.name = f"schunk://{self.path}"

    def put_part(self):
        self.part.width_mm = self.contact_um / 1000

    def commanded(self):
        return bool(self.model.written)

    def commands(self):
        return list(self.model.written)


class Line(line.Line):
    """A line that corrupts answers: each function of `mishaps` gets one request and its answer.

    The function returns the pieces that the master receives instead of the answer.
    """

    def __init__(self):
        super().__init__()
        self.mishaps = []

    def carries(self, frame, reply):
        if self.mishaps:
            return self.mishaps.pop(0)(frame, reply)
        return super().carries(frame, reply)


class VirtualSchunk:
    """A gripper in this thread, on a virtual clock; `connect` returns its driver."""

    def __init__(self, model="schunk-egu", silence_s=SILENCE_S):
        self.clock = VirtualClock()
        self.pace = Pace(self.clock)
        self.part, self.line, self.reports = Part(), Line(), []
        self.model = SchunkModel(random.Random(1), self.part, PROFILES[model])
        self.model.silence_s = silence_s
        self.clock.watch(self.model.next_change)
        slave = RtuSlave(SchunkRegisters(self.model, self.clock.now), self.line, UNIT)
        self.port = GripperPort(slave, self.clock)

    def connect(self, profile=None, **options):
        report = lambda kind, fields: self.reports.append(fields["incident"])  # noqa: E731
        link = SchunkLink(self.port.open(), self.pace, report, UNIT)
        return Gripper(link, self.pace, report, profile, **{"read_only": False, **options})
