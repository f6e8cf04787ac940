"""The simulated gripper on a TCP port: RTU frames as through a serial device server, or Modbus TCP.

Over Modbus TCP the blocks start at 0, the unit is 2, and closing the connection stops the jaws ([M200] p66).
"""

import socket
import threading
from collections.abc import Callable

from drivers.robotiq.frames import TCP
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.wire.line import UnpluggedError
from drivers.sim.wire.modbus import answer
from drivers.sim.wire.rtu import Slave, exchange
from drivers.sim.wire.serving import Lock, SimulatedTime, TcpServer

HEADER = 7  # MBAP: transaction, protocol 0, length, unit


class MbapSlave(Slave):
    """Modbus TCP framing; another protocol gets no answer, too."""

    usual_unit = TCP.unit

    @property
    def pending(self) -> bool:
        """Always False: TCP delivers every byte."""
        return False

    def reply(self, frame: bytes) -> bytes | None:
        """The answer with the request's number, or None for silence."""
        if frame[2:4] != b"\0\0" or frame[6:7] != bytes((self.unit,)):
            return None
        pdu = answer(frame[HEADER:], self._registers)
        if pdu is None:
            return None
        return frame[:4] + (len(pdu) + 1).to_bytes(2, "big") + frame[6:7] + pdu

    def _frame_length(self) -> int:
        if len(self._buffer) < HEADER:
            return 0
        return HEADER - 1 + int.from_bytes(self._buffer[4:6], "big")


def stop_jaws(device: GripperModel, now: Callable[[], float]) -> None:
    """Effect of closing a Modbus TCP connection: rGTO falls to 0."""
    action = device.read_output()[0] & ~0x08
    device.write_output(0, bytes((action,)), now())


class TcpPort(TcpServer):
    """The gripper on a TCP port.

    Args:
        slave: the device.
        lock: held while bytes are served.
        time: simulated time, for late answers.
        hung_up: called when a client leaves.
    """

    def __init__(
        self,
        slave: Slave,
        lock: Lock,
        time: SimulatedTime,
        hung_up: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__("gripper", threading.Event())
        self._slave = slave
        self._lock = lock
        self._time = time
        self._hung_up = hung_up

    def _left(self) -> None:
        if not self._stopped.is_set():
            with self._lock:
                self._hung_up()

    def _serve(self, client: socket.socket) -> None:
        try:
            exchange(self._slave, client.fileno(), self._lock, self._time, self._stopped)
        except UnpluggedError:
            self._stopped.set()
