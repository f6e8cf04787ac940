"""The gripper's register blocks over Modbus: RTU on a serial port, RTU over TCP, Modbus TCP.

Each transaction has a deadline of our own above pymodbus. `read` may be repeated; a write is not, the device
logic reads the state first. Behind a gateway the blocks may have other addresses:

    tcp://192.168.1.20:502?unit=9&output=0x03E8&input=0x07D0&function=3
"""

import contextlib
import struct
import time
from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import parse_qsl

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
from drivers.stream import SerialStream, Stream

GAP_S = 0.005  # manuals ask for 5 ms between commands: the gripper refreshes at 200 Hz ([M16] p55)
LATE_S = 0.02  # wall; how long a line must be quiet after a failure before the next request
DRAIN_S = 0.2  # wall; a line that is never quiet is used all the same after so long
BAUD = 115200
SCAN_BAUDS = (115200, 57600, 38400, 19200, 9600)  # what a 2F can be set to ([M16] p55)
SCAN_UNITS = (RTU.unit, *(unit for unit in range(1, 17) if unit != RTU.unit))
SCAN_S = 0.06
TCP_PORT = 502
# Registers asked for: those that tell something, or more of the block, whose rest is reserved ([M18] p62).
LEAST_REGISTERS, MOST_REGISTERS = BLOCK_BYTES // 2, 8


class Refusal(NamedTuple):
    """What a Modbus exception code means, and what to do."""

    sentence: str
    remedy: str
    passes: bool = False  # whether the same request may be answered a moment later


_WRONG_DEVICE = (
    "check that it is a Robotiq 2F gripper, and unit, output, input and function of its port's name"
)
# Modbus application protocol 1.1b3, section 7. The gripper itself sends none ([M16] p55): gateways do.
EXCEPTIONS = {
    1: Refusal("the function is not known there", _WRONG_DEVICE),
    2: Refusal("no such register", _WRONG_DEVICE),
    3: Refusal("a value that is not allowed", _WRONG_DEVICE),
    4: Refusal("the device failed", "look at its LED and its supply"),
    5: Refusal(
        "it is taken, but takes longer", "ask less often, or raise the gateway's speed", passes=True
    ),
    6: Refusal(
        "the gateway or the gripper is busy", "stop other programs that use it", passes=True
    ),
    10: Refusal(
        "the gateway has no way to that unit", "set up its serial side and its table of units"
    ),
    11: Refusal(
        "the gripper behind the gateway is silent",
        "check its power, its slave id (unit) and the wiring behind the gateway",
        passes=True,
    ),
}


class ModbusLink(StreamLink):
    """A gripper's two register blocks on one Modbus connection, which is owned from now on."""

    def __init__(
        self,
        stream: Stream,
        framing: Framing,
        wiring: Wiring,
        pace: Pace,
        report: Report = no_report,
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
            raise self._refused(request, reply.exception_code)
        return reply

    def _refused(self, request: ModbusPDU, code: int) -> LinkError:
        """A refusal that passes counts as silence: reads are repeated, and a write is looked after."""
        refusal = EXCEPTIONS.get(code, Refusal("an unknown reason", _WRONG_DEVICE))
        self._tell("refused", function=request.function_code, exception=code)
        return (LinkTimeout if refusal.passes else LinkError)(
            f"gripper at {self.endpoint} (unit {self._wiring.unit}) refused function "
            f"{request.function_code}: {refusal.sentence} (exception {code}); {refusal.remedy}"
        )

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
            if piece and (result := self._framing.find(buffer, request)) is not None:
                return result
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


def rtu_link(
    stream: Stream, pace: Pace, report: Report = no_report, wiring: Wiring = RTU
) -> ModbusLink:
    """RTU frames on whatever carries bytes."""
    return ModbusLink(stream, RtuFraming(), wiring, pace, report)


def tcp_link(
    stream: Stream, pace: Pace, report: Report = no_report, wiring: Wiring = TCP
) -> ModbusLink:
    """Modbus TCP."""
    return ModbusLink(stream, TcpFraming(), wiring, pace, report)


def wiring_of(port: str, usual: Wiring) -> Wiring:
    """The wiring that a port's name states after its `?`; what it leaves out is as usual.

    Raises:
        PortError: a setting is not understood, or stated twice.
    """
    block = range(0x10000 - MOST_REGISTERS + 1)
    units = (
        range(1, 248) if usual is RTU else range(256)
    )  # on a bus 0 speaks to all, and nobody answers
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
    """Who answers on a tty: tries slave ids at baud rates, the usual ones first.

    Raises:
        PortError: the port cannot be opened. LinkError: it takes no bytes, or is gone.
    """
    with contextlib.closing(SerialStream(path, BAUD)) as stream:
        for baud in SCAN_BAUDS:
            stream.set_baud(baud)
            yield from (Answered(unit, baud) for unit in SCAN_UNITS if _answers(stream, unit))


def _answers(stream: SerialStream, unit: int) -> bool:
    framing, request = RtuFraming(), read_request(RTU._replace(unit=unit), 1)
    until, buffer = time.monotonic() + SCAN_S, b""
    try:
        while stream.receive(0.0) and time.monotonic() < until:  # what came for the last one
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
