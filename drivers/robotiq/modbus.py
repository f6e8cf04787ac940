"""The gripper's register blocks over Modbus: RTU on a serial port, RTU over TCP, Modbus TCP.

A failed read is repeated. A failed write is not: the device logic first reads the state. Behind a gateway the
blocks may have other addresses:

    tcp://192.168.1.20:502?unit=9&output=0x03E8&input=0x07D0&function=3
"""

import contextlib
import time
from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import parse_qsl

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadInputRegistersRequest

from drivers.clock import Pace
from drivers.errors import LinkError, LinkTimeout, PortError
from drivers.modbus.framing import MAX_BUFFER, Framing, RtuFraming, TcpFraming
from drivers.modbus.master import Master
from drivers.ports import Answered, GripperProfile, Report, no_report
from drivers.robotiq.counts import Counts
from drivers.robotiq.gripper import Gripper
from drivers.robotiq.registers import BLOCK_BYTES
from drivers.stream import SerialStream, Stream, open_tcp, tcp_address

BAUD = 115200
SCAN_BAUDS = (115200, 57600, 38400, 19200, 9600)  # baud rates of a 2F ([M16] p55)
SCAN_S = 0.06
TCP_PORT = 502
# Least and greatest number of registers in a read: those with fields, and the whole block, whose rest is
# reserved ([M18] p62).
LEAST_REGISTERS, MOST_REGISTERS = BLOCK_BYTES // 2, 8


class Wiring(NamedTuple):
    """Slave id, addresses of the register blocks, and function for reading them, on one kind of link."""

    unit: int
    output: int  # address of the first register of the output block
    input: int  # address of the first register of the input block
    function: int  # Modbus function for reading: 3 or 4


RTU = Wiring(unit=9, output=0x03E8, input=0x07D0, function=3)  # [M16] p55
TCP = Wiring(unit=2, output=0, input=0, function=4)  # [M200] p66-78
SCAN_UNITS = (RTU.unit, *(unit for unit in range(1, 17) if unit != RTU.unit))


def read_request(wiring: Wiring, count: int) -> ModbusPDU:
    """Creates a request for the first `count` registers of the input block."""
    kind = ReadInputRegistersRequest if wiring.function == 4 else ReadHoldingRegistersRequest
    return kind(address=wiring.input, count=count, dev_id=wiring.unit)


class ModbusLink(Master):
    """Reads and writes a gripper's two register blocks over one Modbus connection, by default RTU."""

    wrong_device = (
        "check that it is a Robotiq 2F gripper, and unit, output, input and function of "
        "its port's name"
    )

    def __init__(
        self,
        stream: Stream,
        pace: Pace,
        report: Report = no_report,
        wiring: Wiring = RTU,
        framing: Framing | None = None,
    ) -> None:
        super().__init__(stream, pace, report, wiring.unit, framing)
        self._wiring = wiring
        self._count = LEAST_REGISTERS

    def read(self) -> bytes:
        """Reads the input block, 6 bytes; up to 3 attempts, since reading changes nothing."""
        return self._repeated(self._read_once)

    def write(self, block: bytes) -> None:
        """Writes the output block, 6 bytes, once."""
        self._write_data(self._wiring.output, block)

    def _read_once(self) -> bytes:
        return self._read_data(read_request(self._wiring, self._count))[:BLOCK_BYTES]

    def _silent(self, request: ModbusPDU) -> LinkTimeout:
        if not self._framing.numbered:
            # From now on another number of registers is requested, so that a late answer to this
            # request cannot be taken for a later one.
            self._count = self._count + 1 if self._count < MOST_REGISTERS else LEAST_REGISTERS
        return super()._silent(request)


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> Gripper:
    """Opens a Robotiq gripper on a tty, on a serial device server (`rtu+tcp://`), or on Modbus TCP (`tcp://`).

    Raises:
        PortError: the port is invalid or cannot be opened, or the profile has no `counts`.
        LinkError: there is no answer.
    """
    Counts(profile)  # before anything is opened
    scheme, separator, _ = port.partition("://")
    if separator:
        tcp = scheme == "tcp"
        wiring = wiring_of(port, TCP if tcp else RTU)
        address = tcp_address(port.partition("?")[0], TCP_PORT if tcp else 0)
        stream = open_tcp(*address, port, "check address, cable and power")
        link = ModbusLink(stream, pace, report, wiring, TcpFraming() if tcp else None)
    else:
        link = ModbusLink(SerialStream(port, BAUD), pace, report)
    return Gripper(link, pace, report, profile, read_only=read_only)


def wiring_of(port: str, usual: Wiring) -> Wiring:
    """Parses the wiring in a port's name, after its `?`; a setting that is not stated comes from `usual`.

    Raises:
        PortError: a setting is invalid, or repeated.
    """
    block = range(0x10000 - MOST_REGISTERS + 1)
    # On a bus, 0 is the broadcast address, and nobody answers.
    units = range(1, 248) if usual is RTU else range(256)
    allowed = {"unit": units, "output": block, "input": block, "function": (3, 4)}
    settings: dict[str, int] = {}
    for key, text in parse_qsl(port.partition("?")[2], keep_blank_values=True):
        number = -1
        with contextlib.suppress(ValueError):
            number = int(text, 0)
        if key in settings or number not in allowed.get(key, ()):
            raise PortError(
                f"port {port}: {key}={text} is not understood; there are unit ({units[0]} to {units[-1]}), "
                "output and input (addresses of registers) and function (3 or 4), each once"
            )
        settings[key] = number
    return usual._replace(**settings)


def scan(path: str) -> Iterator[Answered]:
    """Yields the devices that answer on a tty; a refusal is an answer, too.

    Asks slave ids 1 to 16 at each baud rate of a 2F, the usual ones first, without parity.

    Raises:
        PortError: the port cannot be opened.
        LinkError: the port takes no bytes, or is gone.
    """
    with contextlib.closing(SerialStream(path, BAUD)) as stream:
        for baud in SCAN_BAUDS:
            stream.set_baud(baud)
            yield from (Answered(unit, baud) for unit in SCAN_UNITS if _answers(stream, unit))


def _answers(stream: SerialStream, unit: int) -> bool:
    framing, request = RtuFraming(), read_request(RTU._replace(unit=unit), 1)
    until, buffer = time.monotonic() + SCAN_S, b""
    try:
        while stream.receive(0.0) and time.monotonic() < until:  # drops pending data
            pass
        stream.send(framing.frame(request))
        until = time.monotonic() + SCAN_S
        while (left := until - time.monotonic()) > 0.0:
            buffer = (buffer + stream.receive(left))[-MAX_BUFFER:]
            if framing.find(buffer, request) is not None:
                return True
    except OSError as error:
        raise LinkError(
            f"port {stream.endpoint} cannot be searched: {error}; check the cable"
        ) from error
    return False
