"""An RTU slave on a pseudo-terminal: frames in, frames out, silence where the real device is silent."""

import contextlib
import os
import select
import threading
import tty

from drivers.robotiq.frames import RTU
from drivers.robotiq.modbus import BAUD
from drivers.sim.wire.line import CleanLine, Outbox, Piece, UnpluggedError
from drivers.sim.wire.modbus import Registers, answer, crc16, frame_length
from drivers.sim.wire.serving import Lock, Server, SimulatedTime

# Wall; the line's own 0.3 ms of silence between frames is below what a scheduler keeps.
GAP_S = 0.010
IDLE_S = 0.05  # wall; between two checks whether the server is to stop
BYTE_S = 10 / BAUD  # 8N1


class Slave:
    """Frames of one slave on a bus, fed with bytes as they come; frames of other units get no answer.

    Args:
        registers: of the slave.
        line: carries its frames.
        unit: its slave id; None: the usual one of a Robotiq gripper.
    """

    usual_unit: int

    def __init__(
        self, registers: Registers, line: CleanLine | None = None, unit: int | None = None
    ) -> None:
        self.unit = self.usual_unit if unit is None else unit
        self._registers = registers
        self._line = line or CleanLine()
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Piece]:
        """Takes bytes off the wire and returns the answer; raises UnpluggedError without a line."""
        self._buffer += data
        pieces: list[Piece] = []
        while length := self._frame_length():
            if len(self._buffer) < length:
                break
            frame = bytes(self._buffer[:length])
            del self._buffer[:length]
            if self._line.hears(frame):
                pieces += self._line.carries(frame, self.reply(frame))
        return pieces

    def silence(self) -> None:
        """The line was quiet: drops an incomplete frame; the next byte starts a new one."""
        self._buffer.clear()

    @property
    def pending(self) -> bool:
        """Whether an unfinished frame is waiting for more, and would end if the line is quiet."""
        return bool(self._buffer)

    def reply(self, frame: bytes) -> bytes | None:
        """The answer to one frame, or None for silence."""
        raise NotImplementedError

    def _frame_length(self) -> int | None:
        """Length of the frame at the start of the buffer; 0 or None: unknown."""
        raise NotImplementedError


class RtuSlave(Slave):
    """RTU frames with CRC."""

    usual_unit = RTU.unit

    def reply(self, frame: bytes) -> bytes | None:
        """The answer, or None for silence: wrong id, bad CRC, unknown function or address."""
        if len(frame) < 4 or frame[0] != self.unit or crc16(frame[:-2]) != frame[-2:]:
            return None
        pdu = answer(frame[1:-2], self._registers)
        if pdu is None:
            return None
        body = bytes((self.unit,)) + pdu
        return body + crc16(body)

    def _frame_length(self) -> int | None:
        return frame_length(self._buffer)


def exchange(
    slave: Slave,
    descriptor: int,
    lock: Lock,
    time: SimulatedTime,
    stopped: threading.Event,
    byte_s: float = 0.0,
) -> None:
    """Serves data on a descriptor until its other end is closed or the server stops.

    Args:
        slave: the device.
        descriptor: of a terminal or a socket.
        lock: held while bytes are served.
        time: simulated time, for the delay of answers.
        stopped: ends it.
        byte_s: duration of a byte, simulated seconds.

    Raises:
        OSError: the connection broke, or the fault schedule has unplugged it.
    """
    outbox = Outbox()
    while not stopped.is_set():
        wait = GAP_S if slave.pending else IDLE_S
        if outbox.next_s is not None:
            wait = max(min(wait, time.wall(outbox.next_s - time.now())), 0.0)
        if select.select([descriptor], [], [], wait)[0]:
            if not (data := os.read(descriptor, 1024)):
                return
            with lock:
                pieces = slave.feed(data)
            outbox.put(pieces, time.now() + len(data) * byte_s, byte_s)
        elif slave.pending:
            slave.silence()
        os.write(descriptor, outbox.due(time.now()))


class PtyPort(Server):
    """An RTU slave behind a pseudo-terminal; `path` is what a master opens.

    Args:
        slave: the device.
        lock: held while a frame is served.
        time: simulated time, for the bytes on a 115200 baud line.
    """

    def __init__(self, slave: RtuSlave, lock: Lock, time: SimulatedTime) -> None:
        super().__init__("gripper", threading.Event())
        self._slave = slave
        self._lock = lock
        self._time = time
        # The slave end stays open here, too: else the master end reports an error whenever a client
        # leaves.
        self._ends = os.openpty()
        tty.setraw(self._ends[1])
        self.path = os.ttyname(self._ends[1])

    def close(self) -> None:
        """Stops serving; the path disappears."""
        super().close()
        self._unplug()

    def _run(self) -> None:
        with contextlib.suppress(UnpluggedError):
            exchange(self._slave, self._ends[0], self._lock, self._time, self._stopped, BYTE_S)
        self._unplug()

    def _unplug(self) -> None:
        """Closes both ends, like a pulled adapter."""
        for descriptor in self._ends:
            with contextlib.suppress(OSError):
                os.close(descriptor)
        self._ends = (-1, -1)
