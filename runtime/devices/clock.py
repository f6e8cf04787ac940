"""The machine's clock; no other runtime module reads the time."""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

LINK_MARGIN_S = 30.0
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")  # random(4)


def date(text: str) -> datetime:
    """Parses a date with or without a time, ISO 8601; UTC where it names no zone.

    Raises:
        ValueError: the text is not a date.
    """
    stated = datetime.fromisoformat(text)
    return stated if stated.tzinfo else stated.replace(tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class SystemClock:
    """The machine's clock, also for a simulated cell that runs faster than real time.

    A second of the machine is `time_scale` seconds of the cell.
    """

    time_scale: float = 1.0

    def now(self) -> float:
        """Present time in seconds of the machine, from an arbitrary fixed moment."""
        return time.monotonic()

    def deadline(self, seconds: float) -> float:
        """Returns the deadline, as a value of `now`, for a motion that begins at this moment.

        The motion may last `seconds` of the cell, which are fewer seconds of the machine if a simulated cell
        runs faster. `LINK_MARGIN_S`, in seconds of the machine, is added for the link to the device.
        """
        return time.monotonic() + seconds / self.time_scale + LINK_MARGIN_S

    def sleep(self, seconds: float) -> None:
        """Sleeps for `seconds` of the cell."""
        time.sleep(max(seconds, 0.0) / self.time_scale)

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond, for records."""
        return datetime.now(UTC).isoformat(timespec="milliseconds")

    def local(self) -> str:
        """Local date and time to the minute: "2026-11-27 18:40"."""
        return time.strftime("%Y-%m-%d %H:%M")

    def local_of(self, stamp: str) -> str:
        """Converts `stamp`, a date and time as records have it, to the form of `local`."""
        return time.strftime("%Y-%m-%d %H:%M", time.localtime(date(stamp).timestamp()))

    def shift(self, changes: Sequence[int]) -> str:
        """Start of the current work shift, in the form of `local`; shifts change at the hours `changes`."""
        now = time.localtime(time.time())
        passed = [hour for hour in changes if hour <= now.tm_hour]
        day = datetime(*now[:3], tzinfo=UTC) - timedelta(days=0 if passed else 1)
        return f"{day.date()} {max(passed or changes):02}:00"

    def uptime(self) -> Mapping[str, object]:
        """The time by a clock that nobody can set: `boot`, digits that identify the boot, and `up_s`.

        `up_s` are the seconds since the boot, including the time that the machine was suspended. Empty where
        the machine does not provide them.
        """
        with suppress(OSError):
            up_s = time.clock_gettime(time.CLOCK_BOOTTIME)
            return {"boot": BOOT_ID.read_text(encoding="ascii")[:8], "up_s": round(up_s, 3)}
        return {}


def age_s(record: Mapping[str, object], now: Mapping[str, object]) -> float | None:
    """Seconds since a record was written; None if that cannot be known.

    If the machine was not rebooted since, the age is the difference between the two `up_s`. Otherwise the age
    is the difference between the two `time`, and counts as known only if it is at least `up_s` of `now`,
    since the record is older than the latest boot.

    Args:
        record: a record with `time`, `boot` and `up_s`, as a journal holds them.
        now: the same fields for this moment.
    """
    since_s, up_s = record.get("up_s"), now.get("up_s")
    if not (isinstance(since_s, int | float) and isinstance(up_s, int | float)):
        return None
    if not (record.get("boot") and now.get("boot")):
        return None
    if record["boot"] == now["boot"]:
        return up_s - since_s if up_s >= since_s else None
    try:
        passed_s = (date(str(now["time"])) - date(str(record["time"]))).total_seconds()
    except (ValueError, KeyError):
        return None
    return passed_s if passed_s >= up_s else None


class Lap:
    """A stopwatch that counts seconds of the cell."""

    def __init__(self, clock: SystemClock) -> None:
        self._clock, self._since = clock, clock.now()
        # clocks of virtual time have no scale
        self._scale = getattr(clock, "time_scale", 1.0)

    def lap(self) -> float:
        """Seconds of the cell since the last lap, or since the stopwatch was created."""
        before, self._since = self._since, self._clock.now()
        return float((self._since - before) * self._scale)
