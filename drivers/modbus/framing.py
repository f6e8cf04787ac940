"""Modbus requests and answers as bytes: encodes a request, and finds its answer in received bytes.

On a serial line an answer may come after noise, after an echo of the request (a half-duplex adapter without
echo suppression) or after an answer to another master. So the search for an answer starts at every byte.
Encoding and decoding are left to pymodbus.
"""

import logging
from functools import lru_cache

from pymodbus import ModbusException
from pymodbus.framer import FramerRTU, FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import WriteMultipleRegistersRequest, WriteSingleRegisterRequest

MAX_BUFFER = 600  # two of the longest RTU frames and some noise
ERROR_BIT = 0x80


class RtuFraming:
    """RTU frames with CRC (Modbus over serial line 1.02); an answer does not name its request."""

    numbered = False  # whether answers carry the number of their request

    def __init__(self) -> None:
        self._framer = FramerRTU(_decoder())
        # A gripper at rest repeats itself; decoding it each time would be most of a poll's cost.
        self._decode = lru_cache(256)(self._decoded)

    def frame(self, pdu: ModbusPDU) -> bytes:
        """Encodes a request."""
        return self._framer.buildFrame(pdu)

    def find(self, buffer: bytes, pdu: ModbusPDU) -> ModbusPDU | None:
        """Returns the first frame in received bytes that answers a request; None if there is none.

        Unit, function and content of the frame must fit the request.
        """
        head = bytes((pdu.dev_id, pdu.function_code))
        for start in range(len(buffer) - 1):
            if buffer[start] != head[0] or buffer[start + 1] & ~ERROR_BIT != head[1]:
                continue
            answer = self._decode(buffer[start:], pdu.dev_id)
            if answer is not None and is_answer(answer, pdu):
                return answer
        return None

    def _decoded(self, frame: bytes, unit: int) -> ModbusPDU | None:
        try:
            return self._framer.handleFrame(frame, unit, 0)[1]
        except ModbusException:
            return None


class TcpFraming:
    """Modbus TCP frames; the header of an answer has the number of its request."""

    numbered = True

    def __init__(self) -> None:
        self._framer = FramerSocket(_decoder())
        self._number = 0

    def frame(self, pdu: ModbusPDU) -> bytes:
        """Encodes a request, and gives it the next transaction number."""
        self._number = self._number % 0xFFFF + 1
        pdu.transaction_id = self._number
        return self._framer.buildFrame(pdu)

    def find(self, buffer: bytes, pdu: ModbusPDU) -> ModbusPDU | None:
        """Returns the answer to a request in received bytes, by the request's number; None if there is none.

        Answers to earlier requests are skipped.
        """
        while buffer:
            try:
                used, answer = self._framer.handleFrame(buffer, pdu.dev_id, pdu.transaction_id)
            except ModbusException:
                return None
            if answer is None:
                return None
            if answer.transaction_id == pdu.transaction_id and is_answer(answer, pdu):
                return answer
            buffer = buffer[used:]
        return None


Framing = RtuFraming | TcpFraming


def _decoder() -> DecodePDU:
    # What pymodbus logs reaches the caller as an exception of `drivers.errors`.
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL + 1)
    return DecodePDU(False)


def is_answer(answer: ModbusPDU, request: ModbusPDU) -> bool:
    """Whether the content of a complete frame fits a request: function, register address and count."""
    if answer.isError():
        return answer.function_code & ~ERROR_BIT == request.function_code
    if answer.function_code != request.function_code:
        return False
    if isinstance(request, WriteSingleRegisterRequest):
        return (answer.address, answer.registers) == (request.address, request.registers)
    if isinstance(request, WriteMultipleRegistersRequest):
        return (answer.address, answer.count) == (request.address, len(request.registers))
    return len(answer.registers) == request.count
