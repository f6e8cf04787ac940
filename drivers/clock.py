"""Time in the drivers: a replaceable clock, and pauses and deadlines in the devices' seconds."""

import threading
import time
from collections.abc import Callable, Iterator

# One transaction, wall time (Robotiq SDK connection_config; devices answer in ~5 ms).
LINK_TIMEOUT_S = 0.5
LATE_LOOKS = 3  # number of reads after a deadline
POLL_S = 0.005  # time between two polls of a busy device; 2F grippers refresh at 200 Hz ([M16] p55)


class Clock:
    """The machine's monotonic clock, in wall seconds; base class of a virtual cell's clock."""

    def now(self) -> float:
        """Seconds since a moment that stays the same while the process runs."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Sleeps for `seconds`."""
        time.sleep(max(seconds, 0.0))

    def every(self, seconds: float, happens: Callable[[], None]) -> Callable[[], None]:
        """Calls `happens` every `seconds` in a separate thread; returns a function that ends the calls."""
        ended = threading.Event()

        def repeat() -> None:
            while not ended.wait(seconds):
                happens()

        threading.Thread(target=repeat, name="every", daemon=True).start()
        return ended.set

    def idle(self, seconds: float, until: float) -> None:
        """Pauses for `seconds` between two polls of a device, at most until the moment `until`.

        A subclass that knows when the device will next change may pause until that change.
        """
        self.sleep(min(seconds, until - self.now()))


class Pace:
    """Pauses and deadlines in device seconds, of which `time_scale` pass in a wall second (hardware: 1)."""

    def __init__(self, clock: Clock, time_scale: float = 1.0) -> None:
        self.clock = clock
        self.time_scale = time_scale

    def now(self) -> float:
        """Returns the time of the clock, wall seconds."""
        return self.clock.now()

    def pause(self, seconds: float) -> None:
        """Sleeps for `seconds` of device time."""
        self.clock.sleep(seconds / self.time_scale)

    def every(self, seconds: float, happens: Callable[[], None]) -> Callable[[], None]:
        """Calls `happens` every `seconds` of device time; returns a function that ends the calls."""
        return self.clock.every(seconds / self.time_scale, happens)

    def idle(self, until: float, seconds: float = POLL_S) -> None:
        """Pauses for `seconds` of device time between two polls, at most until the wall time `until`."""
        self.clock.idle(seconds / self.time_scale, until)

    def polls(self, deadline: float, seconds: float = POLL_S) -> Iterator[None]:
        """Yields before each poll of a busy device; the first poll after the deadline is the last one.

        Between two polls it pauses for `seconds` of device time.
        """
        late = False
        while not late:
            late = self.now() > deadline
            yield
            self.idle(deadline, seconds)

    def looks(self, deadline: float) -> Iterator[float]:
        """Yields the wall seconds until the deadline, once for each read by the caller.

        A read is late if it begins at the deadline or after it; the yielded number is then 0 or negative. The
        iteration ends after `LATE_LOOKS` late reads. They receive data that arrived in time, but was not read
        because this process was stopped.
        """
        late = 0
        while late < LATE_LOOKS:
            left_s = deadline - self.now()
            late += left_s <= 0.0
            yield left_s

    def deadline(self, seconds: float, simulated_s: float = LINK_TIMEOUT_S) -> float:
        """Wall time at which `seconds` of device time will have passed, plus a margin for one last poll.

        The margin is `LINK_TIMEOUT_S`, but `simulated_s` if time runs faster than real time: the device is
        then simulated, and its process may be late on a busy machine.
        """
        margin_s = LINK_TIMEOUT_S if self.time_scale <= 1.0 else simulated_s
        return self.clock.now() + seconds / self.time_scale + margin_s

    def elapsed(self, since: float) -> float:
        """Returns the device seconds that have passed since the wall time `since`."""
        return (self.clock.now() - since) * self.time_scale
