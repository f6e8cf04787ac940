"""An RTU slave on a pseudo-terminal: frames in, frames out, silence where the real device is silent."""

import contextlib
import os
import select
import threading
import tty
from collections.abc import Callable

from drivers.robotiq.modbus import BAUD, RTU
from drivers.sim.modbus import Registers, answer, crc16, frame_length

GAP_S = 0.010  # wall; the line's own 0.3 ms of silence between frames is below what a scheduler keeps
BITS_PER_BYTE = 10  # 8N1


class RtuSlave:
    """Frames of one slave on a bus, fed with bytes as they come.

    Args:
        registers: what it serves.
        unit: slave id; other ids and broadcasts meet silence.
    """

    def __init__(self, registers: Registers, unit: int = RTU.unit) -> None:
        self._registers = registers
        self._unit = unit
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Take bytes off the wire and return the frames to send."""
        self._buffer += data
        replies = []
        while length := frame_length(self._buffer):
            if len(self._buffer) < length:
                break
            frame = bytes(self._buffer[:length])
            del self._buffer[:length]
            if reply := self.reply(frame):
                replies.append(reply)
        return replies

    def silence(self) -> None:
        """The line was quiet: whatever was incomplete is dropped, the next byte starts a frame."""
        self._buffer.clear()

    @property
    def pending(self) -> bool:
        """Whether an unfinished frame is waiting for more."""
        return bool(self._buffer)

    def reply(self, frame: bytes) -> bytes | None:
        """The answer to one frame, or None for silence: wrong id, bad CRC, unknown function or address."""
        if len(frame) < 4 or frame[0] != self._unit or crc16(frame[:-2]) != frame[-2:]:
            return None
        pdu = answer(frame[1:-2], self._registers)
        if pdu is None:
            return None
        body = bytes((self._unit,)) + pdu
        return body + crc16(body)


class PtyPort:
    """An RTU slave behind a pseudo-terminal; `path` is what a master opens.

    Args:
        slave: the device.
        lock: held while a frame is served.
        sleep: pause of simulated seconds; the time the bytes take on a 115200 baud line.
    """

    def __init__(
        self, slave: RtuSlave, lock: "threading.RLock | threading.Lock", sleep: Callable[[float], None]
    ) -> None:
        self._slave = slave
        self._lock = lock
        self._sleep = sleep
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
        for descriptor in (self._master, self._terminal, self._stop_read, self._stop_write):
            os.close(descriptor)

    def _serve(self) -> None:
        while True:
            patience = GAP_S if self._slave.pending else None
            ready = select.select([self._master, self._stop_read], [], [], patience)[0]
            if self._stop_read in ready:
                return
            if not ready:
                self._slave.silence()
                continue
            data = os.read(self._master, 1024)
            with self._lock:
                replies = self._slave.feed(data)
            for reply in replies:
                self._sleep((len(data) + len(reply)) * BITS_PER_BYTE / BAUD)
                with contextlib.suppress(OSError):
                    os.write(self._master, reply)
