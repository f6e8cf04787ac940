"""Which slave answers on a serial port, and at which speed: for a port where nobody answers as expected.

One FC03 request of a single register a try; a gripper that is not addressed, or hears another baud rate,
stays silent ([M16] p55), so trying is harmless.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import serial
from pymodbus.framer import FramerRTU

from drivers.errors import PortError
from drivers.robotiq.frames import RTU
from drivers.robotiq.modbus import BAUD

BAUDS = (115200, 57600, 38400, 19200, 9600)  # what a 2F can be set to ([M16] p55)
UNITS = (RTU.unit, *(unit for unit in range(1, 17) if unit != RTU.unit))
ANSWER_S = 0.06
ANSWER_BYTES = 7


class Answered(NamedTuple):
    """Who answered: slave id and baud rate."""

    unit: int
    baud: int


def scan(path: str, units: Sequence[int] = UNITS, bauds: Sequence[int] = BAUDS) -> Iterator[Answered]:
    """Try slave ids at baud rates, the usual ones first.

    Args:
        path: a tty.
        units: slave ids.
        bauds: rates.

    Yields:
        Each one that answers.

    Raises:
        PortError: the port cannot be opened.
    """
    try:
        port = serial.Serial(path, BAUD, timeout=ANSWER_S, exclusive=True)
    except (serial.SerialException, ValueError) as error:
        raise PortError(f"port {path} cannot be opened: {error}", path) from error
    with port:
        for baud in bauds:
            port.baudrate = baud
            yield from (Answered(unit, baud) for unit in units if _answers(port, unit))


def _answers(port: serial.Serial, unit: int) -> bool:
    port.reset_input_buffer()
    port.write(_framed(bytes((unit, 3)) + RTU.input_address.to_bytes(2, "big") + b"\x00\x01"))
    reply = bytes(port.read(ANSWER_BYTES))
    return reply[:3] == bytes((unit, 3, 2)) and reply == _framed(reply[:-2])


def _framed(body: bytes) -> bytes:
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")
