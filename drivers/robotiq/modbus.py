"""The gripper's register blocks over Modbus: RTU on a serial port, RTU over TCP, Modbus TCP.

One transaction is tried once here, with a deadline of our own above pymodbus; `read` may be repeated, a write
is not (the device logic reads the state first).
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import serial
from pymodbus.framer import FramerRTU
from pymodbus.pdu import ModbusPDU

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout, PortError
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
from drivers.robotiq.link import Report, ReportingLink, no_report
from drivers.robotiq.registers import BLOCK_REGISTERS, to_bytes, to_registers
from drivers.stream import SerialStream, Stream, open_tcp

GAP_S = 0.005  # manuals ask for 5 ms between commands: the gripper refreshes at 200 Hz ([M16] p55)
LATE_S = 0.02  # wall; how long a line must be quiet after a failure before the next request
DRAIN_S = 0.2  # wall; a line that is never quiet is used all the same after so long
BAUD = 115200
SCAN_BAUDS = (115200, 57600, 38400, 19200, 9600)  # what a 2F can be set to ([M16] p55)
SCAN_UNITS = (RTU.unit, *(unit for unit in range(1, 17) if unit != RTU.unit))
SCAN_S = 0.06
SCAN_BYTES = 7
INPUT_REGISTERS = 8  # of the whole block; the last five are reserved ([M18] p62)


class ModbusLink(ReportingLink):
    """A gripper's two register blocks on one Modbus connection.

    Args:
        stream: the connection, owned from now on.
        framing: how requests go onto it.
        wiring: addresses and functions of this kind of link.
        pace: clock of the gap between transactions.
        report: told of every retry and failure, as ("link", {"incident": ..., ...}).
    """

    def __init__(
        self, stream: Stream, framing: Framing, wiring: Wiring, pace: Pace, report: Report = no_report
    ) -> None:
        super().__init__(stream.endpoint, report)
        self._stream = stream
        self._framing = framing
        self._wiring = wiring
        self._pace = pace
        self._free_at = pace.now()
        self._out_of_step = False
        self._late_s = 0.0  # by how much the last answer was read too late
        self._count = BLOCK_REGISTERS

    def read(self) -> bytes:
        """The input block, 6 bytes; tried up to 3 times, since reading changes nothing.

        Raises:
            LinkTimeout: no valid answer to any try.
            LinkError: the connection is gone, or the device refuses the request.
        """
        return self._repeated(self._read_once)

    def write(self, block: bytes) -> None:
        """Write the output block, 6 bytes, once.

        Raises:
            LinkTimeout: no valid answer; whether the write arrived is unknown: read the state before
            repeating it. LinkError: the connection is gone, or the device refuses the request.
        """
        self._transact(write_request(self._wiring, to_registers(block)))

    def close(self) -> None:
        """Close the connection; moves nothing (over Modbus TCP the device then stops itself, [M200] p66)."""
        self._stream.close()
        self._lost = "it was closed"

    def _read_once(self) -> bytes:
        reply = self._transact(read_request(self._wiring, self._count))
        if self._late_s > 0.0:  # it tells of a moment that is too long ago; a write's answer stays true
            raise LinkTimeout(
                f"gripper at {self.endpoint} answered, but this process was stopped or starved and read it "
                f"{self._late_s:.1f} s too late; take load off this machine",
                self.endpoint,
            )
        return to_bytes(tuple(reply.registers[:BLOCK_REGISTERS]))

    def _transact(self, request: ModbusPDU) -> ModbusPDU:
        self._check_open()
        frame = self._framing.frame(request)
        self.counters.transactions += 1
        try:
            self._wait_for_the_line()
            self._out_of_step = True  # until this transaction is answered, or after an interrupt
            self._stream.send(frame)
            reply = self._await_reply(request)
        except OSError as error:
            raise self._broken(error) from error
        finally:
            self._free_at = self._pace.now() + GAP_S / self._pace.time_scale
        if reply is None:
            raise self._silent(request)
        self._out_of_step = False
        if reply.isError():
            raise LinkError(
                f"gripper at {self.endpoint} refused function {request.function_code} (exception "
                f"{reply.exception_code}); check that the device is a Robotiq 2F gripper",
                self.endpoint,
            )
        return reply

    def _wait_for_the_line(self) -> None:
        if (wait := self._free_at - self._pace.now()) > 0.0:
            self._pace.clock.sleep(wait)
        # Whatever lies there answers nothing that is still to be asked.
        quiet_s = LATE_S if self._out_of_step else 0.0
        until = self._pace.now() + DRAIN_S
        while (data := self._stream.receive(quiet_s)) and self._pace.now() < until:
            self.counters.stray_bytes += len(data)

    def _await_reply(self, request: ModbusPDU) -> ModbusPDU | None:
        deadline = self._pace.now() + LINK_TIMEOUT_S
        buffer = b""
        left = LINK_TIMEOUT_S
        while left > 0.0:
            left = deadline - self._pace.now()
            # Past the deadline what is there already counts as well: we may have been stopped meanwhile.
            data = self._stream.receive(max(left, 0.0))
            buffer = (buffer + data)[-MAX_BUFFER:]
            if data and (found := self._framing.find(buffer, request)) is not None:
                self.counters.stray_bytes += found.skipped
                self._late_s = max(self._pace.now() - deadline, 0.0)
                return found.pdu
        self.counters.stray_bytes += len(buffer)
        return None

    def _silent(self, request: ModbusPDU) -> LinkTimeout:
        self.counters.timeouts += 1
        if not self._framing.numbered:
            # From now on another count of registers is asked for, so that an answer to this request which is
            # merely late cannot be taken for the answer to a later one.
            self._count = self._count + 1 if self._count < INPUT_REGISTERS else BLOCK_REGISTERS
        self._tell("no answer", function=request.function_code)
        return LinkTimeout(
            f"gripper at {self.endpoint} did not answer within {LINK_TIMEOUT_S} s; check its power, "
            f"slave id {self._wiring.unit} and wiring",
            self.endpoint,
        )

    def _broken(self, error: OSError) -> LinkError:
        # Never reopened by itself: another device may be there now.
        self._lost = "the connection broke"
        self._stream.close()
        self._tell("connection broke", error=str(error))
        return LinkError(f"gripper link {self.endpoint} broke; check cable, adapter and power", self.endpoint)


def rtu_link(stream: Stream, pace: Pace, report: Report = no_report) -> ModbusLink:
    """RTU frames on whatever carries bytes."""
    return ModbusLink(stream, RtuFraming(), RTU, pace, report)


def open_serial(path: str, pace: Pace, report: Report = no_report) -> ModbusLink:
    """Open a tty as Modbus RTU, 115200 8N1, slave 9.

    Raises:
        PortError: no such device, no permission, not a serial port, or in use.
    """
    return rtu_link(SerialStream(path, BAUD), pace, report)


def open_tcp_link(host: str, port: int, pace: Pace, *, rtu: bool, report: Report = no_report) -> ModbusLink:
    """Open a TCP connection that carries RTU frames (`rtu`) or Modbus TCP.

    Raises:
        PortError: nobody accepts the connection.
    """
    endpoint = f"{'rtu+tcp' if rtu else 'tcp'}://{host}:{port}"
    stream = open_tcp(host, port, endpoint, "check address, cable and power")
    if rtu:
        return rtu_link(stream, pace, report)
    return ModbusLink(stream, TcpFraming(), TCP, pace, report)


class Answered(NamedTuple):
    """Who answered: slave id and baud rate."""

    unit: int
    baud: int


def scan(
    path: str, units: Sequence[int] = SCAN_UNITS, bauds: Sequence[int] = SCAN_BAUDS
) -> Iterator[Answered]:
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
        port = serial.Serial(path, BAUD, timeout=SCAN_S, exclusive=True)
    except (serial.SerialException, ValueError) as error:
        raise PortError(f"port {path} cannot be opened: {error}", path) from error
    with port:
        for baud in bauds:
            port.baudrate = baud
            yield from (Answered(unit, baud) for unit in units if _answers(port, unit))


def _answers(port: serial.Serial, unit: int) -> bool:
    port.reset_input_buffer()
    port.write(_framed(bytes((unit, 3)) + RTU.input_address.to_bytes(2, "big") + b"\x00\x01"))
    reply = bytes(port.read(SCAN_BYTES))
    return reply[:3] == bytes((unit, 3, 2)) and reply == _framed(reply[:-2])


def _framed(body: bytes) -> bytes:
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")
