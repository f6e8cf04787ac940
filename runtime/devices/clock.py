"""The machine's clock; no other runtime module reads the time."""

import time
from dataclasses import dataclass
from datetime import UTC, datetime

LINK_MARGIN_S = 30.0


def date(text: str) -> datetime:
    """A date with or without a time, ISO 8601; UTC where it names no zone.

    Raises:
        ValueError: it is none.
    """
    told = datetime.fromisoformat(text)
    return told if told.tzinfo else told.replace(tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class SystemClock:
    """The machine's monotonic clock; deadlines and pauses are in cell seconds, `time_scale` a second."""

    time_scale: float = 1.0

    def now(self) -> float:
        """Seconds since some fixed moment."""
        return time.monotonic()

    def deadline(self, seconds: float) -> float:
        """Time by which a motion of so many seconds is over; the link's own margin is in real seconds."""
        return time.monotonic() + seconds / self.time_scale + LINK_MARGIN_S

    def sleep(self, seconds: float) -> None:
        """Pause for so many seconds."""
        time.sleep(max(seconds, 0.0) / self.time_scale)

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond: what a record is dated with."""
        return datetime.now(UTC).isoformat(timespec="milliseconds")
