"""What the executor needs of the world around it, as Protocols; the drivers offer it without knowing them.

A driver reports trouble by an exception whose attribute `exit_code` is the exit code of the command (20 link,
21 gripper, 22 arm, 23 port), or by a built-in `TimeoutError`, `ConnectionError` or `OSError`.
"""

from collections.abc import Mapping
from typing import Protocol

# x mm, y mm, z mm, angle rad, of the point midway between the tips; an arm's angle counts whole turns.
Pose = tuple[float, float, float, float]

TURN_RADIUS_MM = 160.0
"""An arm turns the hand so fast that a point so far off its axis moves at the commanded speed."""


class GripperState(Protocol):
    """One fresh reading of the gripper's status registers."""

    @property
    def activated(self) -> bool:
        """Whether the activation sweep is complete."""

    @property
    def moving(self) -> bool:
        """Whether the fingers are on their way."""

    @property
    def fault(self) -> int:
        """The fault code, 0 for none (2F-85 manual, register 2001, FAULT STATUS)."""

    @property
    def object_flag(self) -> int:
        """0 moving, 1 contact while opening, 2 contact while closing, 3 at the requested position."""

    @property
    def echo_counts(self) -> int:
        """The requested position as the gripper repeats it, counts."""

    @property
    def position_counts(self) -> int:
        """The encoder's position, counts: 0 open, 255 closed."""

    @property
    def current_ma(self) -> int:
        """Motor current, mA."""


class Settled(Protocol):
    """A finished motion: request echoed, motion seen finished, several equal positions."""

    @property
    def position_counts(self) -> int:
        """The encoder's position, counts."""

    @property
    def object_flag(self) -> int:
        """1 contact while opening, 2 contact while closing, 3 at the requested position."""

    @property
    def current_ma(self) -> int:
        """Motor current, mA."""

    @property
    def echo_counts(self) -> int:
        """The request this reading belongs to, counts."""

    @property
    def seconds(self) -> float:
        """How long it took from the request, s."""


class Gripper(Protocol):
    """A parallel-jaw gripper. Connecting moved nothing; every call has a deadline of its own."""

    def state(self) -> GripperState:
        """Read the status, once."""

    def activate(self) -> None:
        """Run the activation sweep, fingers fully open and closed; nothing if it is active already."""

    def move(self, position_counts: int, speed_counts: int, force_counts: int) -> None:
        """Request a position, once, and return without waiting."""

    def wait(self) -> Settled:
        """Wait until the requested motion has settled; raises instead of returning a stale reading."""

    def stop(self) -> None:
        """Stop the fingers where they are, on the way of `activate`, too."""

    def close(self) -> None:
        """Let go of the link; moves nothing."""


class Arm(Protocol):
    """An arm that places the point midway between the finger tips, hand pointing down."""

    def pose(self) -> Pose:
        """Read where it is: x, y, z in mm, angle in rad, whole turns counted."""

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Least and greatest angle that the hand can be turned to at a place, rad; may be infinite."""

    def obstacle(self, start: Pose, target: Pose) -> str:
        """Why a straight way cannot be gone, as far as that is known beforehand; empty where nothing is."""

    def move_linear(self, x_mm: float, y_mm: float, z_mm: float, angle_rad: float, speed_mm_s: float) -> None:
        """Move in a straight line and return once it stands there; raises if that is not known.

        The angle is taken as counted, not the shortest way; half a turn or more is gone in several motions.
        """

    def close(self) -> None:
        """Let go of the link; moves nothing."""


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
    def squeezes(self) -> int:
        """Squeezes this part has had."""

    @property
    def crashes(self) -> int:
        """Times open fingers were placed onto this part."""


class Scene(Protocol):
    """The stand-in for the feeder, and the eye that knows the truth; only a simulated cell has one."""

    def next_part(self) -> int:
        """Bring the next part and return its number."""

    def truth(self) -> Truth:
        """Read where the part really lies."""

    def close(self) -> None:
        """Let go of the link."""


class Auditor(Protocol):
    """Judges a predicted pose by other means than touch."""

    def judge(self, part: int, x_mm: float, y_mm: float, theta_rad: float) -> Mapping[str, object]:
        """Judge a predicted pose: `verdict` "pass", "fail" or "unknown", and what was measured."""


class Clock(Protocol):
    """All the time the runtime knows: it waits, dates and judges lateness by this and nothing else.

    Deadlines and pauses are in the cell's own seconds, which a simulated cell may live faster than we do.
    """

    def now(self) -> float:
        """The moment it is, never going back."""

    def deadline(self, seconds: float) -> float:
        """The moment by which a motion of so many cell seconds is over, the link's own time included."""

    def sleep(self, seconds: float) -> None:
        """Pause for so many cell seconds."""

    def stamp(self) -> str:
        """Date and time in UTC, ISO 8601 to the millisecond: what a record is dated with."""


class Journal(Protocol):
    """The record of a run; a record is on the disk when `record` returns."""

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        """Append one record, or raise."""
