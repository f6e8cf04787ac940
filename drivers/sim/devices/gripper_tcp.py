"""The simulated gripper on a TCP port: RTU frames as a serial device server passes them, or Modbus TCP.

Over Modbus TCP the blocks start at 0, the unit is 2, and closing the connection stops the jaws ([M200] p66).
"""

import contextlib
import select
import socket
import threading
from collections.abc import Callable
from typing import Protocol

from drivers.robotiq.frames import TCP
from drivers.sim.wire.line import CleanLine, Piece, UnpluggedError
from drivers.sim.wire.modbus import Device, GripperRegisters, answer
from drivers.sim.wire.rtu import GAP_S, RtuSlave, Time
from drivers.sim.wire.timing import Outbox

HEADER = 7  # MBAP: transaction, protocol 0, length, unit
TCP_FUNCTIONS = frozenset({4, 16})  # no others are promised ([M200] p66)


class Feed(Protocol):
    """Bytes in, answers out; knows when a quiet line ends a frame."""

    @property
    def pending(self) -> bool:
        """Whether an unfinished frame is waiting for more."""

    def feed(self, data: bytes) -> list[Piece]:
        """Take bytes and return what to send."""

    def silence(self) -> None:
        """Nothing came for a while."""


class MbapSlave:
    """Modbus TCP framing; another unit or protocol meets silence.

    Args:
        registers: what it serves.
        line: what its frames meet on the way.
        unit: unit id.
    """

    def __init__(
        self, registers: GripperRegisters, line: CleanLine | None = None, unit: int = TCP.unit
    ) -> None:
        self._registers = registers
        self._line = line or CleanLine()
        self._unit = unit
        self._buffer = bytearray()

    @property
    def pending(self) -> bool:
        """Never: TCP delivers every byte."""
        return False

    def feed(self, data: bytes) -> list[Piece]:
        """Take bytes and return the answers to all whole requests."""
        self._buffer += data
        pieces: list[Piece] = []
        while len(self._buffer) >= HEADER:
            length = HEADER - 1 + int.from_bytes(self._buffer[4:6], "big")
            if len(self._buffer) < length:
                break
            frame = bytes(self._buffer[:length])
            del self._buffer[:length]
            if self._line.hears(frame):
                pieces += self._line.carries(frame, self._reply(frame))
        return pieces

    def _reply(self, frame: bytes) -> bytes | None:
        if frame[2:4] != b"\0\0" or frame[6:7] != bytes((self._unit,)):
            return None
        pdu = answer(frame[HEADER:], self._registers)
        return None if pdu is None else frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + frame[6:7] + pdu

    def silence(self) -> None:
        """Nothing to forget."""


def modbus_tcp(device: Device, now: Callable[[], float], line: CleanLine | None = None) -> MbapSlave:
    """A gripper with a Modbus TCP interface."""
    registers = GripperRegisters(device, now, TCP.output_address, TCP.input_address, TCP_FUNCTIONS)
    return MbapSlave(registers, line)


def rtu_over_tcp(device: Device, now: Callable[[], float], line: CleanLine | None = None) -> RtuSlave:
    """A gripper behind a serial device server."""
    return RtuSlave(GripperRegisters(device, now), line)


def stop_jaws(device: Device, now: Callable[[], float]) -> None:
    """What the closing of a Modbus TCP connection does: rGTO falls to 0."""
    action = device.read_output()[0] & ~0x08
    device.write_output(0, bytes((action,)), now())


class TcpPort:
    """Serves one client at a time on a TCP port of this machine.

    Args:
        feed: the device.
        lock: held while bytes are served.
        time: simulated time, of answers that come late.
        hung_up: called when a client leaves.
    """

    def __init__(
        self,
        feed: Feed,
        lock: "threading.RLock | threading.Lock",
        time: Time,
        hung_up: Callable[[], None] = lambda: None,
    ) -> None:
        self._feed = feed
        self._lock = lock
        self._time = time
        self._hung_up = hung_up
        self._stopped = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, name="gripper", daemon=True)

    def start(self) -> None:
        """Serve until closed."""
        self._thread.start()

    def close(self) -> None:
        """Stop serving."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        with contextlib.suppress(UnpluggedError):
            while not self._stopped.is_set():
                if select.select([self._listener], [], [], 0.05)[0]:
                    self._serve_next()
        self._listener.close()

    def _serve_next(self) -> None:
        client, _ = self._listener.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with client, contextlib.suppress(ConnectionError):
            self._serve_client(client)
        with self._lock:
            self._hung_up()

    def _serve_client(self, client: socket.socket) -> None:
        outbox = Outbox()
        while not self._stopped.is_set():
            if select.select([client], [], [], self._patience(outbox))[0]:
                data = client.recv(1024)
                if not data:
                    return
                with self._lock:
                    pieces = self._feed.feed(data)
                outbox.put(pieces, self._time.now())
            elif self._feed.pending:
                self._feed.silence()
            client.sendall(outbox.due(self._time.now()))

    def _patience(self, outbox: Outbox) -> float:
        """Wall seconds until something has to be done though nothing came."""
        wait = GAP_S if self._feed.pending else 0.05
        if outbox.next_s is None:
            return wait
        return max(min(wait, self._time.wall(outbox.next_s - self._time.now())), 0.0)
