"""Modbus slave: the requests that a gripper knows. Pure functions on bytes.

A gripper never sends exception frames: unsupported requests get no answer ([M16] p55, [ME] p53).
"""

import struct
from functools import lru_cache
from typing import Protocol

from pymodbus.framer import FramerRTU

MAX_REGISTERS = 125  # Modbus application protocol 1.1b3, 6.3


class Registers(Protocol):
    """The registers of a slave."""

    def serves(self, function: int, address: int, count: int) -> bool:
        """Whether `function` is supported and these registers exist."""

    def read(self, address: int, count: int) -> bytes:
        """Reads `count` registers."""

    def write(self, function: int, address: int, data: bytes) -> bool:
        """Writes registers; returns False where that is refused."""


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
