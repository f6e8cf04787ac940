"""An RTU slave on a pseudo-terminal: frames in, frames out, silence where the real device is silent."""

import contextlib
import os
import select
import threading
import tty

from drivers.robotiq.frames import RTU
from drivers.robotiq.modbus import BAUD
from drivers.sim.wire.line import CleanLine, Outbox, Piece, UnpluggedError
from drivers.sim.wire.modbus import GripperRegisters, answer, crc16, frame_length
from drivers.sim.wire.serving import SimulatedTime

GAP_S = 0.010  # wall; the line's own 0.3 ms of silence between frames is below what a scheduler keeps
BYTE_S = 10 / BAUD  # 8N1


class Slave:
    """Frames of one slave on a bus, fed with bytes as they come; another unit's frames meet silence.

    Args:
        registers: what it serves.
        line: what its frames meet on the way.
        unit: slave id.
    """

    def __init__(self, registers: GripperRegisters, line: CleanLine | None, unit: int) -> None:
        self._registers = registers
        self._line = line or CleanLine()
        self._unit = unit
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Piece]:
        """Take bytes off the wire and return what comes back.

        Raises:
            UnpluggedError: there is no line any more.
        """
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
        """The line was quiet: whatever was incomplete is dropped, the next byte starts a frame."""
        self._buffer.clear()

    @property
    def pending(self) -> bool:
        """Whether an unfinished frame is waiting for more, and ends if the line is quiet."""
        return bool(self._buffer)

    def reply(self, frame: bytes) -> bytes | None:
        """The answer to one frame, or None for silence."""
        raise NotImplementedError

    def _frame_length(self) -> int | None:
        """Bytes of the frame at the start of the buffer; 0 or None: not known."""
        raise NotImplementedError


class RtuSlave(Slave):
    """RTU frames with CRC."""

    def __init__(
        self, registers: GripperRegisters, line: CleanLine | None = None, unit: int = RTU.unit
    ) -> None:
        super().__init__(registers, line, unit)

    def reply(self, frame: bytes) -> bytes | None:
        """The answer, or None for silence: wrong id, bad CRC, unknown function or address."""
        if len(frame) < 4 or frame[0] != self._unit or crc16(frame[:-2]) != frame[-2:]:
            return None
        pdu = answer(frame[1:-2], self._registers)
        if pdu is None:
            return None
        body = bytes((self._unit,)) + pdu
        return body + crc16(body)

    def _frame_length(self) -> int | None:
        return frame_length(self._buffer)


class PtyPort:
    """An RTU slave behind a pseudo-terminal; `path` is what a master opens.

    Args:
        slave: the device.
        lock: held while a frame is served.
        time: simulated time; bytes take theirs on a 115200 baud line.
    """

    def __init__(
        self, slave: RtuSlave, lock: "threading.RLock | threading.Lock", time: SimulatedTime
    ) -> None:
        self._slave = slave
        self._lock = lock
        self._time = time
        self._outbox = Outbox()
        # The slave end stays open here too: else the master end reports an error whenever a client leaves.
        self._master, self._terminal = os.openpty()
        tty.setraw(self._terminal)
        self.path = os.ttyname(self._terminal)
        self._stop_read, self._stop_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="gripper", daemon=True)

    def start(self) -> None:
        """Serve until closed."""
        self._thread.start()

    def close(self) -> None:
        """Stop serving; the path is gone."""
        os.write(self._stop_write, b"x")
        if self._thread.is_alive():
            self._thread.join()
        for descriptor in (self._stop_read, self._stop_write):
            os.close(descriptor)
        self._unplug()

    def _serve(self) -> None:
        while True:
            ready = select.select([self._master, self._stop_read], [], [], self._patience())[0]
            if self._stop_read in ready:
                return
            if self._master in ready:
                try:
                    self._hear(os.read(self._master, 1024))
                except UnpluggedError:
                    self._unplug()
                    return
            elif self._slave.pending:
                self._slave.silence()
            with contextlib.suppress(OSError):
                os.write(self._master, self._outbox.due(self._time.now()))

    def _hear(self, data: bytes) -> None:
        with self._lock:
            pieces = self._slave.feed(data)
        self._outbox.put(pieces, self._time.now() + len(data) * BYTE_S, BYTE_S)

    def _patience(self) -> float | None:
        """Wall seconds until something has to be done though nothing came."""
        waits = [GAP_S] if self._slave.pending else []
        if self._outbox.next_s is not None:
            waits.append(max(self._time.wall(self._outbox.next_s - self._time.now()), 0.0))
        return min(waits, default=None)

    def _unplug(self) -> None:
        """Take both ends away, as a pulled adapter does."""
        for descriptor in (self._master, self._terminal):
            with contextlib.suppress(OSError):
                os.close(descriptor)
        self._master = self._terminal = -1
