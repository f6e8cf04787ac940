"""Reads a UR controller by Real-Time Data Exchange, protocol version 2, TCP port 30004.

By Universal Robots' RTDE guide, a package has a size (uint16), a type (one letter) and a payload, big endian.
The stream is started for each reading and paused after it, so that a reading is never older than its request,
and no data accumulates between two readings.
"""

import struct
from typing import NamedTuple

from drivers.clock import Pace
from drivers.errors import read_late, shown
from drivers.stream import Stream

PORT = 30004
VERSION = 2
FREQUENCY_HZ = 125.0
ANSWER_S = 2.0  # wall
HEADER = struct.Struct(">HB")
FORMATS = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I"}
# Output integer registers: number of the move that began, and of the one that ended.
STARTED, DONE = 25, 24
FIELDS = {
    "actual_TCP_pose": "VECTOR6D",
    "tcp_offset": "VECTOR6D",
    "actual_TCP_speed": "VECTOR6D",
    "actual_q": "VECTOR6D",
    "robot_mode": "INT32",
    "robot_status_bits": "UINT32",
    "safety_status_bits": "UINT32",
    "target_speed_fraction": "DOUBLE",
    "runtime_state": "UINT32",
    f"output_int_register_{STARTED}": "INT32",
    f"output_int_register_{DONE}": "INT32",
}
LAYOUT = struct.Struct(">" + "".join(FORMATS[kind] for kind in FIELDS.values()))
Vector = tuple[float, ...]


class RtdeError(OSError):
    """The controller does not answer, or its answer does not follow Universal Robots' RTDE guide."""


class Reading(NamedTuple):
    """The controller at one moment; lengths in m, angles in rad, turns as rotation vectors."""

    tcp: Vector  # pose of the active tool in the base frame: x, y, z, rx, ry, rz
    tcp_offset: Vector  # the active tool in the flange frame
    tcp_speed: Vector  # m/s and rad/s
    joints: Vector  # whole turns counted
    mode: int  # 7: brakes released, ready
    status_bits: int  # bit 0 powered, 1 a program runs
    safety_bits: int  # bit 0 normal, 1 reduced, others: some stop
    speed_fraction: float  # of the pendant's slider
    # of the program: 0 stopping, 1 stopped, 2 playing, 3 pausing, 4 paused, 5 resuming
    runtime_state: int
    started: int  # number of the driver's last started move
    done: int  # number of the driver's last ended move


class Rtde:
    """An RTDE connection on a stream. The constructor only agrees on protocol version and fields.

    Raises:
        RtdeError: the other side does not speak RTDE, or lacks a field.
    """

    def __init__(self, stream: Stream, pace: Pace) -> None:
        self._stream = stream
        self._pace = pace
        self._buffer = b""
        self._late_s = 0.0
        self._out_of_step = False  # data streamed before an interrupt may still be pending
        if self._ask("V", struct.pack(">H", VERSION))[:1] != b"\1":
            raise RtdeError(f"it does not speak RTDE version {VERSION}; update PolyScope")
        reply = self._ask("O", struct.pack(">d", FREQUENCY_HZ) + ",".join(FIELDS).encode("ascii"))
        self._recipe, kinds = reply[:1], reply[1:].decode("latin-1").split(",")
        if kinds != list(FIELDS.values()):
            pairs = zip(FIELDS, kinds, strict=False)
            odd = [f"{name} ({kind})" for name, kind in pairs if kind != FIELDS[name]]
            lacks = shown(", ".join(odd)) or "the fields needed"
            raise RtdeError(f"the controller does not offer {lacks}; update PolyScope")

    def read(self) -> Reading:
        """Reads the controller now.

        Raises:
            RtdeError: the controller does not answer in time or refuses, or a reading was interrupted.
        """
        if self._out_of_step:
            raise RtdeError("a reading was interrupted")
        self._out_of_step = True
        for _ in range(2):
            if self._ask("S") != b"\1":
                raise RtdeError("the controller refuses to start the data exchange")
            payload = self._await("U")
            late_s = self._late_s
            self._ask("P")
            self._out_of_step = False
            if late_s <= 0.0:  # otherwise the data is out of date
                return self._unpacked(payload)
        raise RtdeError(f"it {read_late(late_s)}")

    def _unpacked(self, payload: bytes) -> Reading:
        if payload[:1] != self._recipe or len(payload) != 1 + LAYOUT.size:
            raise RtdeError(f"a data package of {len(payload)} bytes, not {1 + LAYOUT.size}")
        values = iter(LAYOUT.unpack(payload[1:]))
        fields = [
            tuple(next(values) for _ in range(6)) if kind == "VECTOR6D" else next(values)
            for kind in FIELDS.values()
        ]
        return Reading._make(fields)

    def _ask(self, kind: str, payload: bytes = b"") -> bytes:
        self._stream.send(HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload)
        return self._await(kind)

    def _await(self, kind: str) -> bytes:
        """Waits for the next package of a kind and returns its payload; drops packages of other kinds."""
        for left in self._pace.looks(self._pace.now() + ANSWER_S):
            while (package := self._package()) is not None:
                if package[0] == ord(kind):
                    self._late_s = max(-left, 0.0)
                    return package[1]
            self._buffer += self._stream.receive(max(left, 0.0))
        raise RtdeError(f"{ANSWER_S:g} s of silence on RTDE")

    def _package(self) -> tuple[int, bytes] | None:
        if len(self._buffer) < HEADER.size:
            return None
        size, kind = HEADER.unpack_from(self._buffer)
        if size < HEADER.size:
            raise RtdeError(f"a package of {size} bytes; this is no RTDE")
        if len(self._buffer) < size:
            return None
        payload, self._buffer = self._buffer[HEADER.size : size], self._buffer[size:]
        return kind, payload
