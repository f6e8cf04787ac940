"""Modbus slave: answers the requests that a gripper knows. Pure functions on bytes.

A gripper never sends exception frames: it does not answer unsupported requests ([M16] p55, [ME] p53).
"""

from functools import lru_cache
from typing import Protocol

from pymodbus.framer import FramerRTU

MAX_REGISTERS = 125  # Modbus application protocol 1.1b3, 6.3


class Registers(Protocol):
    """What a Modbus slave provides: registers, and the functions that access them."""

    functions: frozenset[int]  # codes of the functions that it supports

    def serves(self, address: int, count: int) -> bool:
        """Whether the slave has these registers."""

    def read(self, address: int, count: int) -> bytes:
        """Reads `count` registers."""

    def write(self, address: int, data: bytes) -> bool:
        """Writes registers; returns False if the slave refuses that."""


def answer(pdu: bytes, registers: Registers) -> bytes | None:
    """Returns the reply to one request (a PDU: function code first), or None for silence."""
    if not pdu or pdu[0] not in registers.functions:
        return None
    match pdu[0]:
        case 3 | 4 if len(pdu) == 5:
            return _read(pdu, registers)
        case 6 if len(pdu) == 5:
            return pdu if registers.write(_word(pdu, 1), pdu[3:]) else None
        case 16 if _counted(pdu[3:]):
            return pdu[:5] if registers.write(_word(pdu, 1), pdu[6:]) else None
        case 23 if _counted(pdu[7:]) and registers.serves(_word(pdu, 1), _word(pdu, 3)):
            # The write takes effect first, and the reading shows it ([M18] p54).
            return _read(pdu, registers) if registers.write(_word(pdu, 5), pdu[10:]) else None
    return None


def _read(pdu: bytes, registers: Registers) -> bytes | None:
    address, count = _word(pdu, 1), _word(pdu, 3)
    if not 1 <= count <= MAX_REGISTERS or not registers.serves(address, count):
        return None
    return bytes((pdu[0], 2 * count)) + registers.read(address, count)


def _counted(tail: bytes) -> bool:
    """Whether a request ends with a count of registers, a count of bytes, and that many bytes."""
    return len(tail) > 3 and tail[2] == len(tail) - 3 == 2 * _word(tail, 0)


def _word(pdu: bytes, at: int) -> int:
    return int.from_bytes(pdu[at : at + 2], "big")


@lru_cache(4096)  # a cell repeats the same few frames
def crc16(data: bytes) -> bytes:
    """Modbus CRC of a frame, low byte first (Modbus over serial line 1.02, 6.2.2)."""
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


def frame_length(head: bytes | bytearray) -> int:
    """Length of the RTU request that starts with `head`; 0 if `head` is too short or its function unknown."""
    if len(head) < 2:
        return 0
    if head[1] in {1, 2, 3, 4, 5, 6}:
        return 8
    at = {15: 6, 16: 6, 23: 10}.get(head[1], len(head))  # place of the count of bytes
    return at + 1 + head[at] + 2 if len(head) > at else 0
