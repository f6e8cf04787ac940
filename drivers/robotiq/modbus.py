"""The gripper's register blocks over Modbus: RTU on a serial port, RTU over TCP, Modbus TCP.

Each transaction has a deadline of our own above pymodbus. `read` may be repeated; a write is not, the device
logic reads the state first.
"""

import struct
from collections.abc import Iterator

import serial
from pymodbus.pdu import ModbusPDU

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, PortError
from drivers.ports import Answered, Report
from drivers.robotiq.frames import (
    MAX_BUFFER,
    RTU,
    TCP,
    Framing,
    RtuFraming,
    TcpFraming,
    Wiring,
    read_request,
    write_request,
)
from drivers.robotiq.link import StreamLink, no_report
from drivers.robotiq.registers import BLOCK_BYTES
from drivers.stream import Stream

GAP_S = 0.005  # manuals ask for 5 ms between commands: the gripper refreshes at 200 Hz ([M16] p55)
LATE_S = 0.02  # wall; how long a line must be quiet after a failure before the next request
DRAIN_S = 0.2  # wall; a line that is never quiet is used all the same after so long
BAUD = 115200
SCAN_BAUDS = (115200, 57600, 38400, 19200, 9600)  # what a 2F can be set to ([M16] p55)
SCAN_UNITS = (RTU.unit, *(unit for unit in range(1, 17) if unit != RTU.unit))
SCAN_S = 0.06
SCAN_BYTES = 7
# Registers asked for: those that tell something, or more of the block, whose rest is reserved ([M18] p62).
LEAST_REGISTERS, MOST_REGISTERS = BLOCK_BYTES // 2, 8


class ModbusLink(StreamLink):
    """A gripper's two register blocks on one Modbus connection, which is owned from now on."""

    def __init__(
        self, stream: Stream, framing: Framing, wiring: Wiring, pace: Pace, report: Report = no_report
    ) -> None:
        super().__init__(stream, pace, report)
        self._framing = framing
        self._wiring = wiring
        self._free_at = pace.now()
        self._out_of_step = False
        self._count = LEAST_REGISTERS

    def read(self) -> bytes:
        """The input block, 6 bytes; tried up to 3 times, since reading changes nothing."""
        return self._repeated(self._read_once)

    def write(self, block: bytes) -> None:
        """Write the output block, 6 bytes, once."""
        self._transact(write_request(self._wiring, block))

    def _read_once(self) -> bytes:
        reply = self._transact(read_request(self._wiring, self._count))
        self._check_in_time()
        return struct.pack(f">{len(reply.registers)}H", *reply.registers)[:BLOCK_BYTES]

    def _transact(self, request: ModbusPDU) -> ModbusPDU:
        self._begin()
        frame = self._framing.frame(request)
        try:
            self._wait_for_the_line()
            self._out_of_step = True  # until this transaction is answered, or after an interrupt
            self._stream.send(frame)
            reply = self._await_reply(request)
        except OSError as error:
            raise self._broken(error, "cable, adapter and power") from error
        finally:
            self._free_at = self._pace.now() + GAP_S / self._pace.time_scale
        if reply is None:
            raise self._silent(request)
        self._out_of_step = False
        if reply.isError():
            raise LinkError(
                f"gripper at {self.endpoint} refused function {request.function_code} (exception "
                f"{reply.exception_code}); check that the device is a Robotiq 2F gripper"
            )
        return reply

    def _wait_for_the_line(self) -> None:
        if (wait := self._free_at - self._pace.now()) > 0.0:
            self._pace.clock.sleep(wait)
        # Whatever lies there answers nothing that is still to be asked.
        quiet_s = LATE_S if self._out_of_step else 0.0
        until = self._pace.now() + DRAIN_S
        while self._stream.receive(quiet_s) and self._pace.now() < until:
            pass

    def _await_reply(self, request: ModbusPDU) -> ModbusPDU | None:
        buffer = b""
        for piece in self._pieces():
            buffer = (buffer + piece)[-MAX_BUFFER:]
            if piece and (found := self._framing.find(buffer, request)) is not None:
                return found
        return None

    def _silent(self, request: ModbusPDU) -> LinkTimeout:
        if not self._framing.numbered:
            # From now on another count of registers is asked for, so that an answer to this request which is
            # merely late cannot be taken for the answer to a later one.
            self._count = self._count + 1 if self._count < MOST_REGISTERS else LEAST_REGISTERS
        self._tell("no answer", function=request.function_code)
        return LinkTimeout(
            f"gripper at {self.endpoint} did not answer within {LINK_TIMEOUT_S} s; check its power, "
            f"slave id {self._wiring.unit} and wiring"
        )


def rtu_link(stream: Stream, pace: Pace, report: Report = no_report) -> ModbusLink:
    """RTU frames on whatever carries bytes."""
    return ModbusLink(stream, RtuFraming(), RTU, pace, report)


def tcp_link(stream: Stream, pace: Pace, report: Report = no_report) -> ModbusLink:
    """Modbus TCP."""
    return ModbusLink(stream, TcpFraming(), TCP, pace, report)


def scan(path: str) -> Iterator[Answered]:
    """Who answers on a tty: tries slave ids at baud rates, the usual ones first.

    Raises:
        PortError: the port cannot be opened.
    """
    try:
        port = serial.Serial(path, BAUD, timeout=SCAN_S, exclusive=True)
    except (serial.SerialException, ValueError) as error:
        raise PortError(f"port {path} cannot be opened: {error}") from error
    with port:
        for baud in SCAN_BAUDS:
            port.baudrate = baud
            yield from (Answered(unit, baud) for unit in SCAN_UNITS if _answers(port, unit))


def _answers(port: serial.Serial, unit: int) -> bool:
    framing, request = RtuFraming(), read_request(RTU._replace(unit=unit), 1)
    port.reset_input_buffer()
    port.write(framing.frame(request))
    return framing.find(bytes(port.read(SCAN_BYTES)), request) is not None
