"""The simulated gripper on a TCP port: RTU frames as a serial device server passes them, or Modbus TCP.

Over Modbus TCP the blocks start at 0, the unit is 2, and closing the connection stops the jaws ([M200] p66).
"""

import contextlib
import select
import socket
import threading
from collections.abc import Callable
from typing import Protocol

from drivers.robotiq.modbus import TCP
from drivers.sim.gripper import GripperModel
from drivers.sim.modbus import GripperRegisters, answer
from drivers.sim.rtu import GAP_S, RtuSlave

HEADER = 7  # MBAP: transaction, protocol 0, length, unit
TCP_FUNCTIONS = frozenset({4, 16})  # no others are promised ([M200] p66)


class Feed(Protocol):
    """Bytes in, answers out; knows when a quiet line ends a frame."""

    @property
    def pending(self) -> bool:
        """Whether an unfinished frame is waiting for more."""
        ...

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return what to send."""
        ...

    def silence(self) -> None:
        """Nothing came for a while."""
        ...


class MbapSlave:
    """Modbus TCP framing; another unit or protocol meets silence.

    Args:
        registers: what it serves.
        unit: unit id.
    """

    def __init__(self, registers: GripperRegisters, unit: int = TCP.unit) -> None:
        self._registers = registers
        self._unit = unit
        self._buffer = bytearray()

    @property
    def pending(self) -> bool:
        """Never: TCP delivers every byte."""
        return False

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes and return the answers to all whole requests."""
        self._buffer += data
        replies = []
        while len(self._buffer) >= HEADER:
            length = HEADER - 1 + int.from_bytes(self._buffer[4:6], "big")
            if len(self._buffer) < length:
                break
            frame = bytes(self._buffer[:length])
            del self._buffer[:length]
            if frame[2:4] != b"\0\0" or frame[6] != self._unit:
                continue
            if (pdu := answer(frame[HEADER:], self._registers)) is not None:
                replies.append(frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + frame[6:7] + pdu)
        return replies

    def silence(self) -> None:
        """Nothing to forget."""


def modbus_tcp(model: GripperModel, now: Callable[[], float]) -> MbapSlave:
    """A gripper with a Modbus TCP interface."""
    return MbapSlave(GripperRegisters(model, now, TCP.output_address, TCP.input_address, TCP_FUNCTIONS))


def rtu_over_tcp(model: GripperModel, now: Callable[[], float]) -> RtuSlave:
    """A gripper behind a serial device server."""
    return RtuSlave(GripperRegisters(model, now))


def stop_jaws(model: GripperModel, now: Callable[[], float]) -> None:
    """What the closing of a Modbus TCP connection does: rGTO falls to 0."""
    action = model.read_output()[0] & ~0x08
    model.write_output(0, bytes((action,)), now())


class TcpPort:
    """Serves one client at a time on a TCP port of this machine.

    Args:
        feed: the device.
        lock: held while bytes are served.
        hung_up: called when a client leaves.
    """

    def __init__(
        self, feed: Feed, lock: "threading.RLock | threading.Lock", hung_up: Callable[[], None]
    ) -> None:
        self._feed = feed
        self._lock = lock
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
        while not self._stopped.is_set():
            if select.select([self._listener], [], [], 0.05)[0]:
                client, _ = self._listener.accept()
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with client, contextlib.suppress(OSError):
                    self._serve_client(client)
                with self._lock:
                    self._hung_up()

    def _serve_client(self, client: socket.socket) -> None:
        while not self._stopped.is_set():
            if not select.select([client], [], [], GAP_S if self._feed.pending else 0.05)[0]:
                self._feed.silence()
                continue
            data = client.recv(1024)
            if not data:
                return
            with self._lock:
                replies = self._feed.feed(data)
            for reply in replies:
                client.sendall(reply)
