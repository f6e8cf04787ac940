"""A DH gripper's registers over Modbus RTU.

An answer does not say which request it belongs to. A reading takes two requests, for blocks of different
lengths, so a late answer usually has the wrong length and is discarded. Since that is not certain, the device
logic does not rely on a single reading.
"""

from collections.abc import Mapping

from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, WriteSingleRegisterRequest

from drivers.dh.registers import CONTROL, STATUS
from drivers.modbus.master import Master


class RtuLink(Master):
    """The registers of one unit on a Modbus connection."""

    wrong_device = "check that it is a gripper of DH-Robotics, and the unit of its port's name"

    def read(self) -> Mapping[int, int]:
        """Reads control registers and states, by address; up to 3 attempts, since reading changes nothing."""
        return self._repeated(self._read_once)

    def write(self, register: int, value: int) -> None:
        """Writes one register; the request is sent once, and never repeated."""
        word = WriteSingleRegisterRequest(address=register, registers=[value], dev_id=self._unit)
        self.transact(word)

    def _read_once(self) -> Mapping[int, int]:
        words: dict[int, int] = {}
        for first, count in (CONTROL, STATUS):
            request = ReadHoldingRegistersRequest(address=first, count=count, dev_id=self._unit)
            words |= enumerate(self.transact(request).registers, first)
            self._check_in_time()
        return words
