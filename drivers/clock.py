"""Time as the drivers use it: a clock that can be replaced, and budgets in the devices' own seconds."""

import threading
import time
from collections.abc import Callable

# One transaction, wall time (Robotiq SDK connection_config; devices answer in ~5 ms).
LINK_TIMEOUT_S = 0.5
POLL_S = 0.005  # between two looks at a busy device: a 2F gripper refreshes at 200 Hz ([M16] p55)


class Clock:
    """The machine's monotonic clock, in wall seconds; a cell on virtual time overrides it."""

    def now(self) -> float:
        """Seconds since some fixed moment."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Pause for so many seconds."""
        time.sleep(max(seconds, 0.0))

    def every(self, seconds: float, happens: Callable[[], None]) -> Callable[[], None]:
        """Have something happen again and again, in a thread of its own; returns what ends that."""
        ended = threading.Event()

        def repeat() -> None:
            while not ended.wait(seconds):
                happens()

        threading.Thread(target=repeat, name="every", daemon=True).start()
        return ended.set

    def idle(self, seconds: float, until: float) -> None:
        """Pause between two looks at a device, for less if the moment `until` comes first.

        A clock that knows when something will next change may pause until then.
        """
        self.sleep(min(seconds, until - self.now()))


class Pace:
    """Waits and deadlines in device seconds; `time_scale` of them, 1 for hardware, pass a wall second."""

    def __init__(self, clock: Clock, time_scale: float = 1.0) -> None:
        self.clock = clock
        self.time_scale = time_scale

    def now(self) -> float:
        """Wall time in s."""
        return self.clock.now()

    def pause(self, seconds: float) -> None:
        """Sleep for so many device seconds."""
        self.clock.sleep(seconds / self.time_scale)

    def every(self, seconds: float, happens: Callable[[], None]) -> Callable[[], None]:
        """Have something happen every so many device seconds; returns what ends that."""
        return self.clock.every(seconds / self.time_scale, happens)

    def idle(self, until: float) -> None:
        """Pause between two looks at a busy device, at most until the wall time `until`."""
        self.clock.idle(POLL_S / self.time_scale, until)

    def deadline(self, seconds: float, simulated_s: float = LINK_TIMEOUT_S) -> float:
        """The wall time at which a device budget is spent, and one last look at the device, at any scale.

        For that a simulated device which is faster than life has `simulated_s`: it is a process that a busy
        machine lets wait, and a budget divided by its scale leaves nothing over.
        """
        margin_s = LINK_TIMEOUT_S if self.time_scale <= 1.0 else simulated_s
        return self.clock.now() + seconds / self.time_scale + margin_s

    def elapsed(self, since: float) -> float:
        """Device seconds since the wall time `since`."""
        return (self.clock.now() - since) * self.time_scale
