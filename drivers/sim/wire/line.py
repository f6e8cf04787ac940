"""The line between gripper and host, and its faults."""

import errno
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from drivers.robotiq.modbus import BAUD
from drivers.sim.faults import Channel, Desk, Listed
from drivers.sim.wire.modbus import crc16

BYTE_S = 10 / BAUD  # 8N1
NETWORK_BYTE_S = 8 / 100e6  # 100 Mbit/s


class Piece(NamedTuple):
    """Bytes that reach the host together, `delay_s` (simulated seconds) later than without a fault."""

    data: bytes
    delay_s: float = 0.0


class UnpluggedError(OSError):
    """The port is gone; if `forbidden`, it exists but may not be opened again."""

    def __init__(self, *, forbidden: bool) -> None:
        super().__init__(errno.EIO, "the port is gone")
        self.forbidden = forbidden


@dataclass
class Line:
    """The line between host and gripper; loses, delays and damages frames as the fault schedule says."""

    desk: Desk = field(default_factory=lambda: Desk(Listed()))
    rng: random.Random = field(default_factory=random.Random)  # draws the noise
    checked: bool = True  # whether frames end in a CRC (RTU)

    def hears(self) -> bool:
        """Counts a request as an event of the schedule; returns whether the gripper receives it.

        Raises:
            UnpluggedError: the line is gone.
        """
        self.desk.next(Channel.LINE)
        for kind in ("unplugged", "permission_lost"):
            if self.desk.holds(kind):
                raise UnpluggedError(forbidden=kind == "permission_lost")
        return self.desk.holds("request_lost") is None

    def carries(self, frame: bytes, reply: bytes | None) -> list[Piece]:
        """Returns the pieces that reach the host after a request: echo and noise, if any, then the reply.

        Current faults may lose, damage, delay or repeat the reply.

        Args:
            frame: the request.
            reply: the answer of the gripper; None: the gripper does not answer.
        """
        faults = {fault.kind: fault for fault in self.desk.holding(Channel.LINE)}
        pieces = [Piece(frame)] if "echo" in faults else []
        if "noise" in faults:
            pieces.append(Piece(self.rng.randbytes(max(int(faults["noise"].value), 1))))
        if reply is None or "reply_lost" in faults:
            return pieces
        for kind, damage in (
            ("wrong_id", self._readdressed),
            ("reply_corrupted", _flipped),
            ("reply_truncated", _cut),
        ):
            if kind in faults:
                reply = damage(reply, int(faults[kind].value))
        delay_s = faults["reply_late"].value if "reply_late" in faults else 0.0
        return pieces + [Piece(reply, delay_s)] * (2 if "reply_twice" in faults else 1)

    def _readdressed(self, reply: bytes, unit: int) -> bytes:
        if not self.checked:  # the unit is the last byte of a Modbus TCP header
            return reply[:6] + bytes((unit,)) + reply[7:]
        body = bytes((unit,)) + reply[1:-2]
        return body + crc16(body)


def _flipped(reply: bytes, bit: int) -> bytes:
    bit %= 8 * len(reply)
    changed = bytearray(reply)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def _cut(reply: bytes, length: int) -> bytes:
    return reply[: min(length, len(reply) - 1)]


@dataclass
class Outbox:
    """Sends pieces over a line one after the other; a delayed piece does not hold up the others."""

    byte_s: float  # duration of a byte
    at: Callable[[float, Callable[[], object]], None]  # schedules a call for a moment
    deliver: Callable[[bytes], object]  # receives the data of a piece that has arrived
    free_s: float = 0.0  # time from which on the line is free

    def put(self, pieces: list[Piece], now_s: float) -> None:
        """Sends pieces; each is delivered as a whole when its last byte has crossed the line."""
        for piece in pieces:
            start_s = now_s + piece.delay_s if piece.delay_s else max(now_s, self.free_s)
            whole_s = start_s + len(piece.data) * self.byte_s
            if not piece.delay_s:
                self.free_s = whole_s
            self.at(whole_s, partial(self.deliver, piece.data))
