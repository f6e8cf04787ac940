"""The machine's clock behind the port `Clock`; no other runtime module reads the time."""

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


def age_s(stamp: str, now: str) -> float:
    """Seconds from one moment to another, each as `date` reads it.

    Raises:
        ValueError: one of them is no such text.
    """
    return (date(now) - date(stamp)).total_seconds()


@dataclass(frozen=True, slots=True)
class SystemClock:
    """The machine's monotonic clock, for a cell that runs `time_scale` times as fast as real time.

    Attributes:
        time_scale: cell seconds per second; 1 for hardware.
    """

    time_scale: float = 1.0

    def now(self) -> float:
        """Seconds since some fixed moment."""
        return time.monotonic()

    def deadline(self, seconds: float) -> float:
        """Time by which a motion of so many cell seconds is over; the link's margin is in real seconds."""
        return time.monotonic() + seconds / self.time_scale + LINK_MARGIN_S

    def sleep(self, seconds: float) -> None:
        """Pause for so many cell seconds."""
        time.sleep(max(seconds, 0.0) / self.time_scale)

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond."""
        return datetime.now(UTC).isoformat(timespec="milliseconds")
