"""The simulated gripper on a TCP port: RTU frames as a serial device server passes them, or Modbus TCP.

Over Modbus TCP the blocks start at 0, the unit is 2, and closing the connection stops the jaws ([M200] p66).
"""

import contextlib
import select
import socket
import threading
from collections.abc import Callable

from drivers.robotiq.frames import TCP
from drivers.sim.wire.line import CleanLine, Outbox, UnpluggedError
from drivers.sim.wire.modbus import Device, GripperRegisters, answer
from drivers.sim.wire.rtu import GAP_S, RtuSlave, Slave
from drivers.sim.wire.serving import SimulatedTime, TcpServer

HEADER = 7  # MBAP: transaction, protocol 0, length, unit
TCP_FUNCTIONS = frozenset({4, 16})  # no others are promised ([M200] p66)


class MbapSlave(Slave):
    """Modbus TCP framing; another protocol meets silence, too."""

    def __init__(
        self, registers: GripperRegisters, line: CleanLine | None = None, unit: int = TCP.unit
    ) -> None:
        super().__init__(registers, line, unit)

    @property
    def pending(self) -> bool:
        """Never: TCP delivers every byte."""
        return False

    def reply(self, frame: bytes) -> bytes | None:
        """The answer with the request's number, or None for silence."""
        if frame[2:4] != b"\0\0" or frame[6:7] != bytes((self._unit,)):
            return None
        pdu = answer(frame[HEADER:], self._registers)
        return None if pdu is None else frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + frame[6:7] + pdu

    def _frame_length(self) -> int:
        if len(self._buffer) < HEADER:
            return 0
        return HEADER - 1 + int.from_bytes(self._buffer[4:6], "big")


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


class TcpPort(TcpServer):
    """The gripper on a TCP port.

    Args:
        slave: the device.
        lock: held while bytes are served.
        time: simulated time, of answers that come late.
        hung_up: called when a client leaves.
    """

    def __init__(
        self,
        slave: Slave,
        lock: "threading.RLock | threading.Lock",
        time: SimulatedTime,
        hung_up: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__("gripper", threading.Event())
        self._slave = slave
        self._lock = lock
        self._time = time
        self._hung_up = hung_up

    def _run(self) -> None:
        with contextlib.suppress(UnpluggedError):
            super()._run()
        self._listener.close()

    def _left(self) -> None:
        with self._lock:
            self._hung_up()

    def _serve(self, client: socket.socket) -> None:
        with contextlib.suppress(ConnectionError):
            self._serve_client(client)

    def _serve_client(self, client: socket.socket) -> None:
        outbox = Outbox()
        while not self._stopped.is_set():
            if select.select([client], [], [], self._patience(outbox))[0]:
                data = client.recv(1024)
                if not data:
                    return
                with self._lock:
                    pieces = self._slave.feed(data)
                outbox.put(pieces, self._time.now())
            elif self._slave.pending:
                self._slave.silence()
            client.sendall(outbox.due(self._time.now()))

    def _patience(self, outbox: Outbox) -> float:
        """Wall seconds until something has to be done though nothing came."""
        wait = GAP_S if self._slave.pending else 0.05
        if outbox.next_s is None:
            return wait
        return max(min(wait, self._time.wall(outbox.next_s - self._time.now())), 0.0)
