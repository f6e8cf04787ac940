"""Time that advances only when somebody waits."""

import heapq
import itertools
import math
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from drivers.clock import LINK_TIMEOUT_S, Clock

AFTER_S = 1e-6  # delay of a poll after the change of the device that it waits for
EPOCH = datetime(2000, 1, 1, tzinfo=UTC)  # date and time at second 0 of every virtual clock


class VirtualClock(Clock):
    """A clock shared by the devices, drivers and runtime of a cell in one thread."""

    def __init__(self) -> None:
        self._now = 0.0
        self._coming: list[tuple[float, int, Callable[[], object]]] = []
        self._number = itertools.count()
        self._watched: list[Callable[[], float]] = []

    @property
    def next_s(self) -> float:
        """The moment of the next scheduled call; infinity if there is none."""
        return self._coming[0][0] if self._coming else math.inf

    def now(self) -> float:
        """Virtual seconds since the clock was created."""
        return self._now

    def deadline(self, seconds: float) -> float:
        """The time at which `seconds` have passed, plus a margin for one last poll of a device."""
        return self._now + seconds + LINK_TIMEOUT_S

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond."""
        return (EPOCH + timedelta(seconds=self._now)).isoformat(timespec="milliseconds")

    def sleep(self, seconds: float) -> None:
        """Advances time by `seconds`, and makes the scheduled calls that are due."""
        self.advance(self._now + max(seconds, 0.0))

    def advance(self, moment: float) -> None:
        """Advances time to a moment, and makes the scheduled calls that are due."""
        while self._coming and self._coming[0][0] <= moment:
            due, _, happens = heapq.heappop(self._coming)
            self._now = max(self._now, due)
            happens()
        self._now = max(self._now, moment)

    def idle(self, seconds: float, until: float) -> None:
        """Advances by `seconds` or to the next change of a watched device, whichever is later.

        The time never goes beyond `until`.
        """
        change = min((watch() for watch in self._watched), default=math.inf) + AFTER_S
        self.advance(min(max(self._now + seconds, change), until))

    def at(self, moment: float, happens: Callable[[], object]) -> None:
        """Schedules a call of `happens` for a moment."""
        heapq.heappush(self._coming, (moment, next(self._number), happens))

    def every(self, seconds: float, happens: Callable[[], None]) -> Callable[[], None]:
        """Schedules a call of `happens` every `seconds`; returns a function that ends the calls."""
        ended: list[bool] = []

        def repeat() -> None:
            if not ended:
                happens()
                self.at(self._now + seconds, repeat)

        self.at(self._now + seconds, repeat)
        return lambda: ended.append(True)

    def watch(self, next_change: Callable[[], float]) -> None:
        """Adds a device for whose changes `idle` waits; `next_change` returns the time of its next change."""
        self._watched.append(next_change)
