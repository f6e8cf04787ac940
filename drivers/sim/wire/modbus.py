"""Modbus slave: the requests that a gripper knows. Pure functions on bytes.

A gripper never sends exception frames: unsupported requests get no answer ([M16] p55, [ME] p53).
"""

import struct
from collections.abc import Callable
from functools import lru_cache
from typing import Protocol

from pymodbus.framer import FramerRTU

from drivers.robotiq.frames import RTU, TCP, Wiring

MAX_REGISTERS = 125  # Modbus application protocol 1.1b3, 6.3
BLOCK_WORDS = 8
# Over Modbus TCP only these are documented ([M200] p66).
FUNCTIONS = {RTU: frozenset({3, 4, 6, 16, 23}), TCP: frozenset({4, 16})}


class Device(Protocol):
    """The two register blocks of a simulated gripper, as in `GripperModel`."""

    def read_input(self, now_s: float) -> bytes:
        """The 16 input bytes."""

    def read_output(self) -> bytes:
        """The 16 output bytes as last written."""

    def write_output(self, offset: int, data: bytes, now_s: float) -> None:
        """Writes bytes of the output block and obeys."""


class Registers(Protocol):
    """The registers of a slave."""

    def serves(self, function: int, address: int, count: int) -> bool:
        """Whether `function` is supported and these registers exist."""

    def read(self, address: int, count: int) -> bytes:
        """Reads `count` registers."""

    def write(self, function: int, address: int, data: bytes) -> bool:
        """Writes registers; returns False where that is refused."""


class GripperRegisters:
    """A Robotiq gripper's two blocks at their wire addresses.

    Args:
        device: the gripper.
        now: simulated seconds.
        wiring: the kind of link.
    """

    def __init__(self, device: Device, now: Callable[[], float], wiring: Wiring = RTU) -> None:
        self._device = device
        self._now = now
        self._output = wiring.output
        self._input = wiring.input
        self._functions = FUNCTIONS[wiring]

    def serves(self, function: int, address: int, count: int) -> bool:
        """Whether `function` is supported and all registers lie in one of the blocks."""
        return function in self._functions and (
            _inside(address, count, self._input) or _inside(address, count, self._output)
        )

    def read(self, address: int, count: int) -> bytes:
        """Reads registers of the input block, or of the output block as last written."""
        if _inside(address, count, self._input):
            block, base = self._device.read_input(self._now()), self._input
        else:
            block, base = self._device.read_output(), self._output
        return block[2 * (address - base) : 2 * (address - base + count)]

    def write(self, function: int, address: int, data: bytes) -> bool:
        """Writes to the output block; the input block cannot be written."""
        if function not in self._functions or not _inside(address, len(data) // 2, self._output):
            return False
        self._device.write_output(2 * (address - self._output), data, self._now())
        return True


def _inside(address: int, count: int, base: int) -> bool:
    return count > 0 and base <= address and address + count <= base + BLOCK_WORDS


def answer(pdu: bytes, registers: Registers) -> bytes | None:
    """The reply to one request (function code first), or None for silence."""
    match pdu[:1]:
        case b"\x03" | b"\x04" if len(pdu) == 5:
            return _read(pdu[0], pdu[1:], registers)
        case b"\x06" if len(pdu) == 5:
            return pdu if registers.write(6, _word(pdu, 1), pdu[3:]) else None
        case b"\x10" if _counted(pdu[3:]):
            return pdu[:5] if registers.write(16, _word(pdu, 1), pdu[6:]) else None
        case b"\x17" if _counted(pdu[7:]) and registers.serves(23, _word(pdu, 1), _word(pdu, 3)):
            # The write takes effect first, and the reading shows it ([M18] p54).
            written = registers.write(23, _word(pdu, 5), pdu[10:])
            return _read(23, pdu[1:5], registers) if written else None
    return None


def _read(function: int, span: bytes, registers: Registers) -> bytes | None:
    address, count = struct.unpack(">HH", span)
    if not 1 <= count <= MAX_REGISTERS or not registers.serves(function, address, count):
        return None
    return bytes((function, 2 * count)) + registers.read(address, count)


def _counted(tail: bytes) -> bool:
    """Whether a request ends with a count of registers, a count of bytes, and that many bytes."""
    return len(tail) > 3 and tail[2] == len(tail) - 3 == 2 * _word(tail, 0)


def _word(pdu: bytes, at: int) -> int:
    return int.from_bytes(pdu[at : at + 2], "big")


@lru_cache(4096)  # a cell repeats the same few frames
def crc16(data: bytes) -> bytes:
    """Modbus CRC of a frame, low byte first (Modbus over serial line 1.02, 6.2.2)."""
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


def frame_length(head: bytes | bytearray) -> int | None:
    """Length of the RTU request that starts with `head`; 0: not known yet, None: unknown function."""
    if len(head) < 2:
        return 0
    function = head[1]
    if function in {1, 2, 3, 4, 5, 6}:
        return 8
    at = {15: 6, 16: 6, 23: 10}.get(function)
    if at is None:
        return None
    return at + 1 + head[at] + 2 if len(head) > at else 0
