"""Time that passes only when somebody waits."""

import heapq
import itertools
import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from drivers.clock import LINK_TIMEOUT_S, Clock

AFTER_S = 1e-6  # a look at a device that changes at some moment comes just after it
EPOCH = datetime(2000, 1, 1, tzinfo=UTC)  # when every simulated cell comes up


class VirtualClock(Clock):
    """A clock for a cell in one thread: as the drivers want one, and as the runtime does."""

    def __init__(self) -> None:
        self._now = 0.0
        self._coming: list[tuple[float, int, Callable[[], None]]] = []
        self._number = itertools.count()
        self._watched: list[Callable[[], float]] = []

    @property
    def next_s(self) -> float:
        """The next moment at which something is to happen; infinity: nothing is."""
        return self._coming[0][0] if self._coming else math.inf

    def now(self) -> float:
        """Seconds since the cell came up."""
        return self._now

    def deadline(self, seconds: float) -> float:
        """The moment by which so many seconds are over, a last look at a device included."""
        return self._now + seconds + LINK_TIMEOUT_S

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond."""
        return (EPOCH + timedelta(seconds=self._now)).isoformat(timespec="milliseconds")

    def sleep(self, seconds: float) -> None:
        """Let time pass, and with it what was to happen meanwhile."""
        self.advance(self._now + max(seconds, 0.0))

    def advance(self, moment: float) -> None:
        """Let time pass until a moment."""
        while self._coming and self._coming[0][0] <= moment:
            due, _, happens = heapq.heappop(self._coming)
            self._now = max(self._now, due)
            happens()
        self._now = max(self._now, moment)

    def idle(self, seconds: float, until: float) -> None:
        """Go to the next moment at which a device changes, at least `seconds` and at most to `until`."""
        change = min((watch() for watch in self._watched), default=math.inf) + AFTER_S
        self.advance(min(max(self._now + seconds, change), until))

    def at(self, moment: float, happens: Callable[[], None]) -> None:
        """Have something happen at a moment."""
        heapq.heappush(self._coming, (moment, next(self._number), happens))

    def every(self, seconds: float, happens: Callable[[], None]) -> Callable[[], None]:
        """Have something happen again and again; returns what ends that."""
        ended: list[bool] = []

        def repeat() -> None:
            if not ended:
                happens()
                self.at(self._now + seconds, repeat)

        self.at(self._now + seconds, repeat)
        return lambda: ended.append(True)

    def watch(self, next_change: Callable[[], float]) -> None:
        """Take a device's word for when it will next look different."""
        self._watched.append(next_change)
