"""The whole cell in one thread on a virtual clock: the same bytes, no threads, no waiting.

Drivers and simulated devices exchange real RTU frames and open_abb strings; only the ports are in memory, and
time passes when somebody waits for it. The same seed gives the same run, byte for byte.
"""

from collections.abc import Callable

from drivers.abb.arm import Arm, over
from drivers.abb.reach import Setup
from drivers.clock import Pace
from drivers.ports import Report, Truth
from drivers.robotiq.gripper import Gripper
from drivers.robotiq.link import Link, no_report
from drivers.robotiq.modbus import rtu_link
from drivers.sim.faults import Listed
from drivers.sim.physics.scene import Setting
from drivers.sim.physics.scene_protocol import truth_of
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.virtual.ports import ArmPort, GripperPort
from drivers.sim.wire.modbus import GripperRegisters
from drivers.sim.wire.rtu import RtuSlave
from drivers.sim.workcell import ARM_BASE, Workcell


class VirtualScene:
    """Feeder and ground truth, as `drivers.connect.scene` gives them."""

    def __init__(self, works: Workcell) -> None:
        self._works = works

    def next_part(self) -> int:
        """Take the part away and bring the next; returns its number."""
        return int(str((self._works.answer("next_part") or {})["part"]))

    def truth(self) -> Truth:
        """Where the part really is."""
        return truth_of(self._works.answer("truth") or {})

    def close(self) -> None:
        """Nothing to close."""


class VirtualCell:
    """A cell whose time is `clock`; its devices are connected to as often as one likes.

    Attributes:
        clock: the cell's time, shared by devices, drivers and runtime.
        pace: the drivers' deadlines on it.
        works: what the cell consists of.
        scene: its feeder and ground truth.

    Args:
        setting: part and world.
        seed: of every draw.
        faults: what goes wrong when; None: nothing.
        overheard: told of each string that the arm's controller receives.
    """

    def __init__(
        self,
        setting: Setting,
        seed: int,
        faults: Listed | None = None,
        overheard: Callable[[str], None] | None = None,
    ) -> None:
        self.clock = VirtualClock()
        self.pace = Pace(self.clock)
        self.works = Workcell(setting, seed, self.clock.now, faults)
        self.scene = VirtualScene(self.works)
        self.clock.watch(self.works.gripper.next_change)
        slave = RtuSlave(GripperRegisters(self.works.device, self.clock.now), self.works.line())
        self._gripper_port = GripperPort(slave, self.clock)
        self._arm_port = ArmPort(self.works.controller, self.clock, self.works.arm_stands, overheard)

    def link(self, report: Report = no_report) -> Link:
        """The gripper's register blocks over RTU frames.

        Raises:
            PortError: the port is gone.
        """
        return rtu_link(self._gripper_port.open(), self.pace, report)

    def gripper(self, report: Report = no_report) -> Gripper:
        """The driver, connected.

        Raises:
            PortError: the port is gone. LinkError: the gripper does not answer.
        """
        return Gripper(self.link(report), self.pace, report)

    def arm(self) -> Arm:
        """The driver, connected; it knows where the base is and refuses what it cannot reach.

        Raises:
            ArmError: the controller does not answer.
        """
        return over(self._arm_port.connect, self.pace, Setup(base=ARM_BASE))
