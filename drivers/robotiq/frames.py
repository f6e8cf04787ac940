"""Where the register blocks of a Robotiq gripper are on Modbus, and the request that reads them."""

from typing import NamedTuple

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest


class Wiring(NamedTuple):
    """Addresses of the register blocks on one kind of link, and the function for reading them."""

    unit: int
    output: int  # address of the first register of the output block
    input: int
    function: int  # of reading: 3 or 4


RTU = Wiring(unit=9, output=0x03E8, input=0x07D0, function=3)  # [M16] p55
TCP = Wiring(unit=2, output=0, input=0, function=4)  # [M200] p66-78


def read_request(wiring: Wiring, count: int) -> ModbusPDU:
    """Request for the first `count` registers of the input block."""
    kind = ReadInputRegistersRequest if wiring.function == 4 else ReadHoldingRegistersRequest
    return kind(address=wiring.input, count=count, dev_id=wiring.unit)
