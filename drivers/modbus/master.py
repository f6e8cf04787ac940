"""One Modbus connection to a gripper: transactions, one after the other, each with a deadline."""

import struct
from typing import NamedTuple

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import WriteMultipleRegistersRequest

from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import LinkError, LinkTimeout
from drivers.links import StreamLink
from drivers.modbus.framing import MAX_BUFFER, Framing, RtuFraming
from drivers.ports import Report
from drivers.stream import Stream

GAP_S = 0.005  # time between two requests: grippers refresh at 200 Hz, or slower
LATE_S = 0.02  # wall; silence of the line required after a failure, before the next request


class Refusal(NamedTuple):
    """What a Modbus exception code means, and what to do about it."""

    sentence: str
    remedy: str = ""  # empty: `Master.wrong_device` is the remedy
    passes: bool = False  # whether the same request may succeed a moment later


# Modbus application protocol 1.1b3, section 7. A gripper may send none of them; gateways do.
EXCEPTIONS = {
    1: Refusal("the function is not known there"),
    2: Refusal("no such register"),
    3: Refusal("a value that is not allowed"),
    4: Refusal("the device failed", "look at its LED and its supply"),
    5: Refusal(
        "it is taken, but takes longer", "ask less often, or raise the gateway's speed", True
    ),
    6: Refusal("the gateway or the gripper is busy", "stop other programs that use it", True),
    10: Refusal(
        "the gateway has no way to that unit", "set up its serial side and its table of units"
    ),
    11: Refusal(
        "the gripper behind the gateway is silent",
        "check its power, its slave id (unit) and the wiring behind the gateway",
        True,
    ),
}


class Master(StreamLink):
    """A connection to a gripper; owns the stream, and enforces the deadline of each transaction.

    Args:
        stream: carries the bytes.
        pace: device time.
        report: receives every failure.
        unit: slave id.
        framing: framing of the requests and answers; None: RTU.
    """

    wrong_device: str  # what to check if the device does not know a request

    def __init__(
        self, stream: Stream, pace: Pace, report: Report, unit: int, framing: Framing | None = None
    ) -> None:
        super().__init__(stream, pace, report)
        self._unit = unit
        self._framing = framing or RtuFraming()
        self._free_at = pace.now()
        self._out_of_step = False

    def transact(self, request: ModbusPDU) -> ModbusPDU:
        """Sends a request once and returns its answer.

        Raises:
            LinkTimeout: there was no valid answer; it is unknown whether the request arrived.
            LinkError: the connection is gone, or the device refuses.
        """
        self._begin()
        frame = self._framing.frame(request)
        try:
            self._wait_for_the_line()
            self._out_of_step = True  # until this request is answered
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

    def _read_data(self, request: ModbusPDU) -> bytes:
        """Reads registers, high byte first; raises LinkTimeout if the answer is out of date."""
        registers = self.transact(request).registers
        self._check_in_time()
        return struct.pack(f">{len(registers)}H", *registers)

    def _write_data(self, address: int, data: bytes) -> None:
        """Writes registers from an address on, once."""
        registers = [*struct.unpack(f">{len(data) // 2}H", data)]
        unit = self._unit
        request = WriteMultipleRegistersRequest(address=address, registers=registers, dev_id=unit)
        self.transact(request)

    def _refused(self, request: ModbusPDU, code: int) -> LinkError:
        """Creates the error for a refusal of a request.

        It is a LinkTimeout if the refusal is temporary: callers then repeat reads, and check writes.
        """
        refusal = EXCEPTIONS.get(code, Refusal("an unknown reason"))
        self._tell("refused", function=request.function_code, exception=code)
        return (LinkTimeout if refusal.passes else LinkError)(
            f"gripper at {self.endpoint} (unit {request.dev_id}) refused function "
            f"{request.function_code}: {refusal.sentence} (exception {code}); "
            f"{refusal.remedy or self.wrong_device}"
        )

    def _wait_for_the_line(self) -> None:
        if (wait := self._free_at - self._pace.now()) > 0.0:
            self._pace.clock.sleep(wait)
        self._drain(LATE_S if self._out_of_step else 0.0)

    def _await_reply(self, request: ModbusPDU) -> ModbusPDU | None:
        buffer = b""
        for piece in self._pieces():
            buffer = (buffer + piece)[-MAX_BUFFER:]
            if piece and (result := self._framing.find(buffer, request)) is not None:
                return result
        return None

    def _silent(self, request: ModbusPDU) -> LinkTimeout:
        self._tell("no answer", function=request.function_code)
        return LinkTimeout(
            f"gripper at {self.endpoint} did not answer within {LINK_TIMEOUT_S} s; check its power, "
            f"slave id {request.dev_id} and wiring"
        )
