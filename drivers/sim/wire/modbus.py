"""Modbus as a slave speaks it: the requests a gripper knows, RTU frames with CRC. Pure functions on bytes.

A gripper never sends exception frames: what it cannot serve meets silence ([M16] p55, [ME] p53).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

MAX_READ, MAX_WRITE, MAX_READ_WRITE = 125, 123, 121  # Modbus application protocol 1.1b3, 6.3, 6.12, 6.17
BLOCK_WORDS = 8


class Device(Protocol):
    """The two register blocks of a simulated gripper, as `GripperModel` has them."""

    def read_input(self, now_s: float) -> bytes:
        """The 16 input bytes."""

    def read_output(self) -> bytes:
        """The 16 output bytes as last written."""

    def write_output(self, offset: int, data: bytes, now_s: float) -> None:
        """Write bytes of the output block and obey."""


class GripperRegisters:
    """A gripper's two blocks at their wire addresses.

    Args:
        model: the gripper.
        now: simulated seconds.
        output_address: first register of the host's block.
        input_address: first register of the gripper's block.
        functions: function codes this kind of link serves.
    """

    def __init__(
        self,
        model: Device,
        now: Callable[[], float],
        output_address: int = 0x03E8,
        input_address: int = 0x07D0,
        functions: frozenset[int] = frozenset({3, 4, 6, 16, 23}),
    ) -> None:
        self._model = model
        self._now = now
        self._output = output_address
        self._input = input_address
        self._functions = functions

    def serves(self, function: int, address: int, count: int) -> bool:
        """Whether `function` is spoken here and all registers lie in one of the blocks."""
        return function in self._functions and (
            _inside(address, count, self._input) or _inside(address, count, self._output)
        )

    def read(self, address: int, count: int) -> bytes:
        """Registers of the input block, or of the output block as last written."""
        if _inside(address, count, self._input):
            block, base = self._model.read_input(self._now()), self._input
        else:
            block, base = self._model.read_output(), self._output
        return block[2 * (address - base) : 2 * (address - base + count)]

    def write(self, function: int, address: int, data: bytes) -> bool:
        """Write to the output block; the input block cannot be written."""
        if function not in self._functions or not _inside(address, len(data) // 2, self._output):
            return False
        self._model.write_output(2 * (address - self._output), data, self._now())
        return True


def _inside(address: int, count: int, base: int) -> bool:
    return base <= address and address + count <= base + BLOCK_WORDS


def answer(pdu: bytes, registers: GripperRegisters) -> bytes | None:
    """The reply to one request (function code first), or None for silence."""
    serve = {3: _read, 4: _read, 6: _write_one, 16: _write_many, 23: _read_write}.get(pdu[0]) if pdu else None
    return serve(pdu, registers) if serve else None


def _word(pdu: bytes, at: int) -> int:
    return int.from_bytes(pdu[at : at + 2], "big")


def _read(pdu: bytes, registers: GripperRegisters) -> bytes | None:
    count = _word(pdu, 3)
    if len(pdu) != 5 or not 1 <= count <= MAX_READ or not registers.serves(pdu[0], _word(pdu, 1), count):
        return None
    return bytes((pdu[0], 2 * count)) + registers.read(_word(pdu, 1), count)


def _write_one(pdu: bytes, registers: GripperRegisters) -> bytes | None:
    if len(pdu) != 5 or not registers.write(6, _word(pdu, 1), pdu[3:5]):
        return None
    return pdu


def _write_many(pdu: bytes, registers: GripperRegisters) -> bytes | None:
    count, data = _word(pdu, 3), pdu[6:]
    if len(pdu) < 6 or not 1 <= count <= MAX_WRITE or not pdu[5] == len(data) == 2 * count:
        return None
    return pdu[:5] if registers.write(16, _word(pdu, 1), data) else None


def _read_write(pdu: bytes, registers: GripperRegisters) -> bytes | None:
    """The write takes effect first, the reading shows it ([M18] p54)."""
    count, write_count, data = _word(pdu, 3), _word(pdu, 7), pdu[10:]
    if len(pdu) < 10 or not 1 <= count <= MAX_READ or not 1 <= write_count <= MAX_READ_WRITE:
        return None
    if not pdu[9] == len(data) == 2 * write_count:
        return None
    # An address that cannot be read must not be found out after the write has moved something.
    if not registers.serves(23, _word(pdu, 1), count) or not registers.write(23, _word(pdu, 5), data):
        return None
    return bytes((23, 2 * count)) + registers.read(_word(pdu, 1), count)


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
    return byte


_REMAINDERS = tuple(_remainder(byte) for byte in range(256))


@lru_cache(4096)  # a cell says the same few things over and over
def crc16(data: bytes) -> bytes:
    """Modbus CRC of a frame, low byte first (Modbus over serial line 1.02, 6.2.2)."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _REMAINDERS[(crc ^ byte) & 0xFF]
    return crc.to_bytes(2, "little")


def frame_length(head: bytes | bytearray) -> int | None:
    """Bytes of the RTU request that starts with `head`; 0: cannot be told yet, None: unknown function."""
    if len(head) < 2:
        return 0
    function = head[1]
    if function in {1, 2, 3, 4, 5, 6}:
        return 8
    at = {15: 6, 16: 6, 23: 10}.get(function)
    if at is None:
        return None
    return at + 1 + head[at] + 2 if len(head) > at else 0
