"""Time as the drivers use it: a clock that can be replaced, and budgets in the devices' own seconds."""

import time
from typing import Protocol

LINK_TIMEOUT_S = 0.5  # one transaction, wall time (Robotiq SDK connection_config; devices answer in ~5 ms)
POLL_S = 0.005  # between two looks at a busy device: a 2F gripper refreshes at 200 Hz ([M16] p55)


class Clock(Protocol):
    """Monotonic time in wall seconds; a virtual clock may replace it."""

    def now(self) -> float:
        """Seconds since some fixed moment."""

    def sleep(self, seconds: float) -> None:
        """Pause for so many seconds."""

    def idle(self, seconds: float, until: float) -> None:
        """Pause between two looks at a device.

        Args:
            seconds: the pause. A clock that knows when something will next change may pause until then.
            until: the moment by which the next look is due, whatever happens.
        """


class WallClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Seconds since some fixed moment."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Pause for so many seconds."""
        time.sleep(max(seconds, 0.0))

    def idle(self, seconds: float, until: float) -> None:
        """Pause for so many seconds, or less if `until` comes first."""
        self.sleep(min(seconds, until - self.now()))


class Pace:
    """Waits and deadlines stated in device seconds, spent on a clock that may run a faster cell.

    Args:
        clock: the clock to read and sleep on, in wall seconds.
        time_scale: device seconds per wall second: 1 for hardware, more for a simulated cell.
    """

    def __init__(self, clock: Clock, time_scale: float = 1.0) -> None:
        if not time_scale > 0.0:
            raise ValueError(f"time scale {time_scale} is not positive; hardware runs at 1")
        self.clock = clock
        self.time_scale = time_scale

    def now(self) -> float:
        """Wall time in s."""
        return self.clock.now()

    def pause(self, seconds: float) -> None:
        """Sleep for so many device seconds."""
        self.clock.sleep(seconds / self.time_scale)

    def idle(self, until: float) -> None:
        """Pause between two looks at a busy device, at most until the wall time `until`."""
        self.clock.idle(POLL_S / self.time_scale, until)

    def deadline(self, seconds: float) -> float:
        """The wall time at which a device budget is spent.

        One link timeout is added, undivided: the last look at a device may take that long, however fast it
        lives.
        """
        return self.clock.now() + seconds / self.time_scale + LINK_TIMEOUT_S

    def elapsed(self, since: float) -> float:
        """Device seconds since the wall time `since`."""
        return (self.clock.now() - since) * self.time_scale
