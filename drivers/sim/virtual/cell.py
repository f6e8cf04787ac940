"""The whole cell in one thread on a virtual clock: the real protocols, over ports in memory.

Time advances only when somebody waits. The same seed gives the same run, byte for byte.
"""

from collections.abc import Callable

from drivers.abb.arm import Arm, over
from drivers.abb.reach import Setup
from drivers.clock import Pace
from drivers.ports import Gripper, Report, no_report
from drivers.sim.faults import Listed
from drivers.sim.physics.scene import Setting
from drivers.sim.physics.scene_protocol import Feeder
from drivers.sim.virtual.clock import VirtualClock
from drivers.sim.virtual.ports import ArmPort, GripperPort
from drivers.sim.workcell import ARM_BASE, Workcell
from drivers.stream import Stream


class VirtualCell:
    """A cell with virtual time; its devices can be connected repeatedly.

    Args:
        setting: part and world.
        seed: seed of all random numbers.
        faults: schedule of faults; None: no faults.
        overheard: called with each string that the arm's controller receives; None: nobody listens.
    """

    def __init__(
        self,
        setting: Setting,
        seed: int,
        faults: Listed | None = None,
        overheard: Callable[[str], None] | None = None,
    ) -> None:
        self.clock = VirtualClock()  # shared by devices, drivers and runtime
        self.pace = Pace(self.clock)
        self.works = Workcell(setting, seed, self.clock.now, faults)
        self.scene = Feeder(lambda what: self.works.answer(what) or {})
        self.clock.watch(self.works.gripper.next_change)
        slave = self.works.simulator.slave(self.works.gripper, self.clock.now, self.works.line())
        self._gripper_port = GripperPort(slave, self.clock)
        self._arm_port = ArmPort(self.works.arm, self.clock, self.works.arm_stands, overheard)

    def serial(self) -> Stream:
        """Opens the gripper's serial port; raises PortError if it is gone."""
        return self._gripper_port.open()

    def gripper(self, report: Report = no_report) -> Gripper:
        """Connects a driver to the gripper.

        Raises:
            PortError: the port is gone.
            LinkError: there is no answer.
        """
        simulator = self.works.simulator
        link = simulator.link(self.serial(), self.pace, report)
        return simulator.gripper(link, self.pace, report, self.works.profile)

    def arm(self) -> Arm:
        """Connects a driver to the arm, and gives the driver the arm's base frame.

        Raises:
            ArmError: there is no answer.
        """
        return over(self._arm_port.connect, self.pace, Setup(base=ARM_BASE))
