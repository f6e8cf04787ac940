"""What the executor needs of the world around it besides gripper and arm (`drivers.ports`), as Protocols.

A driver reports trouble by an exception whose attribute `exit_code` is the exit code of the command (20 link,
21 gripper, 22 arm, 23 port), or by a built-in `TimeoutError`, `ConnectionError` or `OSError`.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Protocol

from drivers.ports import Arm, Gripper

Report = Callable[[str, Mapping[str, object]], None]
"""Told of every retry and failure on a link, as kind and fields of a record."""


class Truth(Protocol):
    """What only a simulated cell knows about its part; a pose of NaN where its world has none."""

    @property
    def x_mm(self) -> float:
        """World x of the part, mm."""

    @property
    def y_mm(self) -> float:
        """World y of the part, mm."""

    @property
    def theta_rad(self) -> float:
        """World angle of the part, rad."""

    @property
    def crashes(self) -> int:
        """Times open fingers were placed onto this part."""


class Scene(Protocol):
    """Stand-in for the feeder, and ground truth of the part's pose; only a simulated cell has one."""

    def next_part(self) -> int:
        """Bring the next part and return its number."""

    def truth(self) -> Truth:
        """Read where the part really lies."""

    def close(self) -> None:
        """Close the link."""


class Auditor(Protocol):
    """Judges a predicted pose by other means than touch."""

    def judge(self, part: int, x_mm: float, y_mm: float, theta_rad: float) -> Mapping[str, object]:
        """Judge a predicted pose: `verdict` "pass", "fail" or "unknown", and what was measured."""


class Clock(Protocol):
    """The runtime's only source of time: for waits, deadlines and dates.

    Deadlines and pauses are in cell seconds; a simulated cell may run faster than real time.
    """

    def now(self) -> float:
        """Monotonic time, s."""

    def deadline(self, seconds: float) -> float:
        """The moment by which a motion of so many cell seconds is over, the link's own time included."""

    def sleep(self, seconds: float) -> None:
        """Pause for so many cell seconds."""

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond: what a record is dated with."""


class Journal(Protocol):
    """The journal of a run; a record is on the disk when `record` returns."""

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Append one record, or raise."""


class Heard(Protocol):
    """A slave that answered a scan."""

    @property
    def unit(self) -> int:
        """Slave id."""

    @property
    def baud(self) -> int:
        """Baud rate."""


class Drivers(Protocol):
    """What opens devices; `drivers.connect`."""

    def gripper(
        self, port: str, *, time_scale: float = 1.0, read_only: bool = False, report: Report = ...
    ) -> Gripper:
        """Connect to a gripper, moving nothing."""

    def arm(self, url: str, *, time_scale: float = 1.0, read_only: bool = False) -> Arm:
        """Connect to an arm, moving nothing."""

    def scene(self, url: str) -> Scene:
        """Connect to a simulated cell's scene."""

    def scan(self, port: str) -> Iterator[Heard]:
        """Who answers on a serial port."""
