"""A simulated DH gripper on a serial line in memory: real bytes, virtual time."""

import random

from drivers.clock import Pace
from drivers.dh import registers as dh
from drivers.dh.gripper import Gripper
from drivers.dh.link import RtuLink
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.jaws import Surroundings
from drivers.sim.faults import Desk, Fault, Listed
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.virtual.ports import GripperPort
from drivers.sim.wire.line import Line
from drivers.sim.wire.rtu import RtuSlave
from runtime.table import profile_of

LONG = 10_000  # requests, more than any test sends


class VirtualDh(Surroundings):
    """A simulated DH gripper; a part stops its fingers at `contact_mm`, unless this is None."""

    def __init__(self, *, contact_mm: float | None = None, seed: int = 1) -> None:
        self.contact_mm = contact_mm
        self.profile = profile_of("dh-ag95")
        self.clock = VirtualClock()
        self.device = DhModel(random.Random(seed), self, self.profile)
        self.clock.watch(self.device.next_change)
        self.incidents: list[str] = []
        self.desk = Desk(Listed())
        line = Line(self.desk, random.Random(seed))
        slave = RtuSlave(DhRegisters(self.device, self.clock.now), line, dh.UNIT)
        self.port = GripperPort(slave, self.clock)

    def closing(self) -> float | None:
        return self.contact_mm

    def connect(self) -> Gripper:
        """Returns the gripper's driver."""
        pace = Pace(self.clock)

        def report(kind, fields):
            self.incidents.append(fields["incident"])

        return Gripper(RtuLink(self.port.open(), pace, report, dh.UNIT), pace, report, self.profile)

    def ready(self) -> Gripper:
        """Returns the driver after it has initialised the gripper."""
        gripper = self.connect()
        gripper.activate()
        return gripper

    def fault(self, kind: str, *, length: int = LONG, value: float = 0.0) -> None:
        """Injects a fault of a kind (drivers/sim/FAULTS.md) into the next `length` requests."""
        self.desk._schedule = Listed([Fault(kind, at=0, length=length, value=value)])
        self.desk.begin(0)


def close(gripper: Gripper, speed_mm_s: float = 100.0) -> None:
    """Commands the fingers to close."""
    gripper.move(0, speed_mm_s, 45.0)
