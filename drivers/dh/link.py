"""A DH gripper's registers over Modbus RTU.

No number ties an answer to its request. The two blocks of a reading have different lengths and are read in
turn, so an answer that comes too late is mostly passed over; device logic believes no single reading.
"""

from collections.abc import Mapping
from typing import Protocol

from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, WriteSingleRegisterRequest

from drivers.clock import Pace
from drivers.dh.registers import CONTROL, STATUS, UNIT
from drivers.errors import ReadOnlyError
from drivers.links import no_report
from drivers.modbus.framing import RtuFraming
from drivers.modbus.master import Master
from drivers.ports import Report
from drivers.stream import Stream


class Link(Protocol):
    """The registers of one gripper."""

    endpoint: str

    def read(self) -> Mapping[int, int]:
        """Control registers and states; may repeat itself."""

    def write(self, register: int, value: int) -> None:
        """Write one register exactly once; whether it arrived is unknown after a LinkTimeout."""

    def close(self) -> None:
        """Give the link up without moving anything."""


class RtuLink(Master):
    """The registers of one unit on a Modbus connection."""

    def __init__(
        self, stream: Stream, pace: Pace, report: Report = no_report, unit: int = UNIT
    ) -> None:
        hint = "check that it is a gripper of DH-Robotics, and the unit of its port's name"
        super().__init__(stream, RtuFraming(), pace, report, wrong_device=hint)
        self._unit = unit

    def read(self) -> Mapping[int, int]:
        """Control registers and states; tried up to 3 times, since reading changes nothing."""
        return self._repeated(self._read_once)

    def write(self, register: int, value: int) -> None:
        """Write one register, once."""
        self.transact(
            WriteSingleRegisterRequest(address=register, registers=[value], dev_id=self._unit)
        )

    def _read_once(self) -> Mapping[int, int]:
        words: dict[int, int] = {}
        for first, count in (CONTROL, STATUS):
            request = ReadHoldingRegistersRequest(address=first, count=count, dev_id=self._unit)
            words |= enumerate(self.transact(request).registers, first)
            self._check_in_time()
        return words


class ReadOnlyLink:
    """The registers without a way to write: frames of a write are never built. Owns the link."""

    def __init__(self, link: Link) -> None:
        self.endpoint = link.endpoint
        self.read, self.close = link.read, link.close

    def write(self, register: int, value: int) -> None:
        """Refuse, by a ReadOnlyError."""
        raise ReadOnlyError(
            f"a dry run was about to write {value} to register 0x{register:04X} of the gripper at "
            f"{self.endpoint}"
        )
