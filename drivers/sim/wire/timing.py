"""Simulated time on the machine's clock, and bytes that wait for their moment."""

import threading
import time

from drivers.sim.wire.line import Piece


class SimulatedTime:
    """Simulated seconds: wall time since the start, times the scale.

    Args:
        scale: simulated seconds per wall second.
        stopped: ends every pause early.
    """

    def __init__(self, scale: float, stopped: threading.Event) -> None:
        self._scale = scale
        self._stopped = stopped
        self._start = time.monotonic()

    def now(self) -> float:
        """Simulated seconds since the cell came up."""
        return (time.monotonic() - self._start) * self._scale

    def sleep(self, seconds: float) -> None:
        """Pause for so many simulated seconds, or until the cell stops."""
        self._stopped.wait(seconds / self._scale)

    def wall(self, seconds: float) -> float:
        """Wall seconds of so many simulated ones."""
        return seconds / self._scale


class Outbox:
    """What has still to be sent, each piece at its moment. One goes out after the other."""

    def __init__(self) -> None:
        self._waiting: list[tuple[float, bytes]] = []
        self._free_s = 0.0

    def put(self, pieces: list[Piece], now_s: float, byte_s: float = 0.0) -> None:
        """Take pieces; each is whole on the other side once its bytes have crossed a line of that speed."""
        for piece in pieces:
            start_s = now_s + piece.delay_s if piece.delay_s else max(now_s, self._free_s)
            whole_s = start_s + len(piece.data) * byte_s
            if not piece.delay_s:
                self._free_s = whole_s
            self._waiting.append((whole_s, piece.data))
        self._waiting.sort(key=lambda waiting: waiting[0])

    def due(self, now_s: float) -> bytes:
        """Whatever has arrived by now."""
        if not self._waiting or self._waiting[0][0] > now_s:
            return b""
        arrived = [data for moment_s, data in self._waiting if moment_s <= now_s]
        self._waiting = [waiting for waiting in self._waiting if waiting[0] > now_s]
        return b"".join(arrived)

    @property
    def next_s(self) -> float | None:
        """When the next piece arrives; None: nothing is on its way."""
        return self._waiting[0][0] if self._waiting else None
