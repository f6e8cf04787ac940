"""The simulators of grippers, by model: the device, its ports and its driver."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivers.clock import Pace
from drivers.dh import registers as dh
from drivers.dh.gripper import Gripper as DhGripper
from drivers.dh.link import RtuLink
from drivers.ports import Gripper, GripperProfile, Report
from drivers.robotiq.gripper import Gripper as RobotiqGripper
from drivers.robotiq.modbus import RTU, TCP, ModbusLink
from drivers.schunk import registers as schunk
from drivers.schunk.gripper import Gripper as SchunkGripper
from drivers.schunk.link import SchunkLink
from drivers.sim.devices.dh import DhModel, DhRegisters
from drivers.sim.devices.gripper import GripperModel, GripperRegisters
from drivers.sim.devices.gripper_urcap import MAX_LINE, Urcap
from drivers.sim.devices.jaws import Fingers
from drivers.sim.devices.schunk import SchunkModel, SchunkRegisters
from drivers.sim.wire.line import Line
from drivers.sim.wire.modbus import Registers
from drivers.sim.wire.rtu import MbapSlave, RtuSlave, open_port, open_pty
from drivers.sim.wire.serving import HOST, Site
from drivers.stream import Stream
from runtime.shell.errors import UsageError
from runtime.table import same_model


@dataclass(frozen=True)
class Simulator:
    """What simulates the grippers of one make: the device, its registers, and the driver to connect to it."""

    model: type[Fingers]  # the simulated device
    registers: Callable[[Any, Callable[[], float]], Registers]  # by device and clock
    unit: int  # slave id on the serial line
    scheme: str  # prefix of the serial port's path for `drivers.connect`
    link: Callable[[Stream, Pace, Report], Any]  # creates the driver's link on that line
    # creates the driver on that link
    gripper: Callable[[Any, Pace, Report, GripperProfile], Gripper]

    def slave(self, device: Any, now: Callable[[], float], line: Line) -> RtuSlave:
        """Creates the Modbus slave of the device, on the gripper's end of a serial line."""
        return RtuSlave(self.registers(device, now), line, self.unit)

    def ports(
        self, device: Any, site: Site, line: Callable[..., Line]
    ) -> tuple[str, dict[str, str]]:
        """Opens all ports of the device; a host uses only one of them.

        Args:
            device: the gripper.
            site: simulated time and event loop.
            line: creates a line to the gripper; `checked=False`: its frames have no CRC.

        Returns:
            Path of the serial port, and the addresses of the other ports.
        """
        return open_pty(self.slave(device, site.now, line()), site), {}


class RobotiqSimulator(Simulator):
    """Simulator of Robotiq grippers, which also have TCP ports and the URCap."""

    def ports(
        self, device: Any, site: Site, line: Callable[..., Line]
    ) -> tuple[str, dict[str, str]]:
        """Opens a serial port, and TCP ports for RTU, Modbus TCP and the URCap; returns their addresses."""
        path, _ = super().ports(device, site, line)
        rtu = open_port(self.slave(device, site.now, line()), site)
        slave = MbapSlave(GripperRegisters(device, site.now, TCP), line(checked=False), TCP.unit)
        tcp = open_port(slave, site, lambda: device.hang_up(site.now()))
        urcap = site.answer_lines(Urcap(device, site.now).answer, MAX_LINE)
        return path, {
            "gripper_tcp": f"tcp://{HOST}:{tcp}",
            "gripper_rtu_tcp": f"rtu+tcp://{HOST}:{rtu}",
            "gripper_urcap": f"urcap://{HOST}:{urcap}",
        }


ROBOTIQ = RobotiqSimulator(GripperModel, GripperRegisters, RTU.unit, "", ModbusLink, RobotiqGripper)
DH_LINK, SCHUNK_LINK = partial(RtuLink, unit=dh.UNIT), partial(SchunkLink, unit=schunk.UNIT)
DH = Simulator(DhModel, DhRegisters, dh.UNIT, "dh://", DH_LINK, DhGripper)
SCHUNK = Simulator(
    SchunkModel, SchunkRegisters, schunk.UNIT, "schunk://", SCHUNK_LINK, SchunkGripper
)
SIMULATORS = {
    **dict.fromkeys(("robotiq-2f-85", "robotiq-2f-140", "hand-e"), ROBOTIQ),
    **dict.fromkeys(("dh-ag95", "dh-pgc140-50"), DH),
    **dict.fromkeys(("schunk-egu", "schunk-egk"), SCHUNK),
}


def simulator(model: str) -> Simulator:
    """Returns the simulator of a model, in any spelling; raises a UsageError if the model is unknown."""
    for name, result in SIMULATORS.items():
        if same_model(name, model):
            return result
    raise UsageError(f"there is no simulated gripper {model}; there are {', '.join(SIMULATORS)}")
