"""Interfaces of a cell's devices, of any make.

A driver, in this package or in a separate one, satisfies these Protocols without inheriting from them.
`drivers.contract` has the tests that every make passes; tools/docs/drivers.md is the guide.

Rules that a type cannot express:

- Connecting reads and never moves anything, and never resets a device that may hold a part.
- Every call has a deadline, and a call that fails raises an error of `drivers.errors`.
- A motion is requested once. If it is unknown whether the request arrived, the state is read before the
  request is repeated; after a silence that leaves the state unknown, every further motion is refused.
- `wait` returns a reading that belongs to the last `move` and to no earlier one, or raises.
- `close` moves nothing.
- A driver opened with `read_only` sends no command: the lowest of its layers that distinguishes commands from
  reads refuses each command with a `drivers.errors.ReadOnlyError`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

# x mm, y mm, z mm, angle rad, of the point between the tips
PoseOfHand = tuple[float, float, float, float]
MOST_COUNT = 255  # greatest count of a device that reports widths as counts
# Greatest distance of a point of an unknown gripper, or of the part that it holds, from the hand's axis.
TURN_RADIUS_MM = 160.0

# Function that receives every retry and failure on a link as a record: its kind and its fields. The method
# `record` of a journal is such a function.
Report = Callable[[str, Mapping[str, object]], None]


def no_report(kind: str, fields: Mapping[str, object]) -> None:
    """Discards a report."""


class ObjectState(IntEnum):
    """Whether and how an object stopped the fingers; a journal stores the number of the state."""

    NONE = 0  # unknown: the fingers are moving, or were never asked to move
    OPENING = 1  # something stopped the fingers while opening
    CLOSING = 2  # something stopped the fingers while closing
    AT_TARGET = 3  # the fingers are at the requested width

    @property
    def sentence(self) -> str:
        """Describes the state in words for a message."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True, slots=True)
class GripperProfile:
    """Capabilities and properties of one model of a gripper.

    Widths are nominal: distances between the faces of the maker's fingers. A calibration
    (`grasp-calibrate width`) corrects them. Readings lie on a grid: `steps + 1` widths from 0 to the stroke.
    """

    model: str  # name in jobs
    stroke_um: int  # width of the jaws fully open; closed on nothing they read 0
    resolution_um: float  # step of a reading
    noise_um: int  # standard deviation of a reading, without its rounding
    speed_mm_s: tuple[float, float]  # rate of the width, slowest and fastest
    force_n: tuple[float, float]  # grip force, weakest and strongest
    held_um: int = 2000  # width from which closed fingers are expected to hold a part
    empty_um: int = 5000  # width up to which the object state may miss a held part
    streams: bool = False  # whether the gripper accepts a request while the fingers move
    # Link and offset of the arc on which the tips move, mm. A link alone: the offset has to be measured.
    # Empty: the tips move straight.
    arc_mm: tuple[float, ...] = ()
    # Extent of a usual fingertip along the hand's x, and along y, in which it moves.
    fingers_mm: tuple[float, float] = (25.0, 10.0)
    # Counts of the open and closed jaws, if the device counts from 0 to `MOST_COUNT`.
    counts: tuple[int, int] | None = None
    # Greatest rate of the width at which the gripper exerts its whole force; for less force, the rate is
    # proportionally lower. None: the gripper exerts any force at any speed.
    grip_mm_s: float | None = None
    # Distance of the gripper's farthest point from its axis, jaws open, with the maker's fingers.
    radius_mm: float = TURN_RADIUS_MM

    @property
    def steps(self) -> int:
        """Number of steps of the grid of readings."""
        return round(self.stroke_um / self.resolution_um)

    @property
    def usual_force_n(self) -> float:
        """Grip force if a job states none: 40 N, which is low, or the nearest force of the gripper."""
        return _within(40.0, self.force_n)

    def fastest_grip_mm_s(self, force_n: float) -> float:
        """Greatest closing speed (rate of the width) at which the gripper still exerts a given force."""
        if self.grip_mm_s is None:
            return self.speed_mm_s[1]
        return max(self.grip_mm_s * force_n / self.force_n[1], self.speed_mm_s[0])

    def usual_speed_mm_s(self, force_n: float) -> float:
        """Closing speed if a job states none: at most 60 mm/s, and slow enough to grip with the force."""
        return _within(min(60.0, self.fastest_grip_mm_s(force_n)), self.speed_mm_s)

    @property
    def gentle_mm_s(self) -> float:
        """Closing speed on a gauge block: 20 mm/s, or the nearest speed of the gripper.

        The slowest speed of some grippers would take a minute for a stroke.
        """
        return _within(20.0, self.speed_mm_s)

    def reading_um(self, step: int) -> int:
        """Width at a step of the grid, rounded to 1 um; steps count from 0 (closed), also beyond the ends."""
        return (2 * self.stroke_um * step + self.steps) // (2 * self.steps)

    def step(self, width_um: float) -> int:
        """The step of the grid nearest to a width."""
        return round(width_um * self.steps / self.stroke_um)

    def counted_um(self, count: int) -> int:
        """Converts a position count of the device to a width; only for profiles with `counts`.

        Also converts counts beyond the counts of the open and closed jaws.
        """
        assert self.counts is not None
        return self.reading_um(self.counts[1] - count)


def _within(value: float, bounds: tuple[float, float]) -> float:
    return min(max(value, bounds[0]), bounds[1])


@dataclass(frozen=True, slots=True)
class GripperState:
    """State of a gripper according to one reading. Widths are nominal, see `GripperProfile`."""

    activated: bool  # whether the gripper is ready to move, as after `activate`; a fault may still forbid it
    moving: bool  # whether the fingers are moving
    fault: int  # fault code of the device; 0: no fault
    fault_text: str  # meaning and remedy, a sentence; empty without a fault
    object: ObjectState
    # the requested width as the device echoes it, up to the stroke; it outlasts a connection. A request to
    # close as far as possible is echoed as a negative width by a device that can, else as 0.
    target_um: int
    # position of the fingers; slightly below 0 or above the stroke beyond the nominal ends
    width_um: int
    current_ma: int  # motor current; 0 if unknown


class Settled(NamedTuple):
    """End of a move: all values are from readings after the fingers came to rest."""

    width_um: int  # width at which the fingers rest
    object: ObjectState  # never `NONE`
    current_ma: int  # motor current
    target_um: int  # the request this reading belongs to
    seconds: float  # device seconds since the request


@runtime_checkable
class Gripper(Protocol):
    """A parallel-jaw gripper."""

    @property
    def profile(self) -> GripperProfile:
        """Profile of the gripper's model."""

    def state(self) -> GripperState:
        """Reads the gripper's state now.

        Raises:
            LinkError: the gripper cannot be reached.
        """

    def activate(self) -> None:
        """Makes the gripper ready to move; if it was not, the fingers may move over their whole stroke.

        Raises:
            GripperFault: the gripper cannot be made ready.
        """

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Requests a width on the grid of readings, and returns at once.

        A negative width closes the fingers as far as they go; a width equal to the stroke opens them as far
        as they go. The device is set to its greatest speed and force that do not exceed the arguments, or
        else to its least ones.

        Raises:
            GripperFault: the gripper is not ready, or reports a fault.
        """

    def wait(self) -> Settled:
        """Waits until the last move has settled.

        Raises:
            GripperFault: the move does not settle in time, or the reading cannot be trusted.
        """

    def stop(self) -> None:
        """Stops the fingers where they are, also during `activate`; a held part stays held."""

    def close(self) -> None:
        """Closes the link."""


@runtime_checkable
class Arm(Protocol):
    """An arm whose hand points down; its poses are those of the point midway between the finger tips."""

    def pose(self) -> PoseOfHand:
        """Reads the pose of the hand; the angle counts whole turns of the wrist.

        Raises:
            ArmError: the arm is silent, or its hand does not point down.
        """

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Least and greatest angle of the hand at a place, rad; may be infinite.

        Raises:
            ArmError: the arm is silent, or the angle of its wrist contradicts the counted turns.
        """

    def obstacle(self, start: PoseOfHand, target: PoseOfHand) -> str:
        """Returns why a straight motion is impossible; empty if no reason is known beforehand."""

    def move_linear(
        self, target: PoseOfHand, speed_mm_s: float, radius_mm: float = TURN_RADIUS_MM
    ) -> None:
        """Moves in a straight line, and returns when the hand is at rest at the target.

        Angles that differ by whole turns are different targets. The caller must split half a turn or more
        into several motions: an arm may be unable to choose the direction of such a turn. The speed also
        limits turns: no point within `radius_mm` of the hand's axis moves faster.

        Raises:
            ArmError: the motion was refused before anything was sent, or the arm's state is unknown from now
                on.
        """

    def close(self) -> None:
        """Closes the link."""


class Truth(NamedTuple):
    """Ground truth about the part, which only a simulated cell has."""

    x_mm: float  # pose of the part in the world; NaN where the cell's world has none
    y_mm: float
    theta_rad: float
    squeezes: int  # number of squeezes
    crashes: int  # times open fingers were placed on the part
    status: str  # result of the last squeeze
    covered: bool = False  # whether the camera's view is blocked
    hypothesis: int = 0  # index of the part's hypothesis


class Scene(Protocol):
    """Stand-in for the feeder of a simulated cell, and source of the ground truth."""

    def next_part(self) -> int:
        """Removes the part, brings the next and returns its number."""

    def truth(self) -> Truth:
        """Reads the ground truth about the part."""

    def close(self) -> None:
        """Closes the link."""


class Answered(NamedTuple):
    """Slave id and baud rate of a device that answered a scan."""

    unit: int
    baud: int


class Drivers(Protocol):
    """Functions that open devices; implemented by `drivers.connect`, which documents the addresses."""

    def gripper(
        self,
        port: str,
        profile: GripperProfile | None = None,
        *,
        time_scale: float = 1.0,
        read_only: bool = False,
        report: Report = ...,
    ) -> Gripper:
        """Connects to a gripper, moving nothing; `profile` is the expected gripper's profile."""

    def arm(self, url: str, *, time_scale: float = 1.0, read_only: bool = False) -> Arm:
        """Connects to an arm, moving nothing."""

    def scene(self, url: str) -> Scene:
        """Connects to a simulated cell's scene."""

    def virtual(self, tree: Path, *, world: str, seed: int, report: Report = ...) -> Any:
        """Creates a simulated cell in this process, in virtual time; returns gripper, arm, scene, clock."""

    def scan(self, port: str) -> Iterator[Answered]:
        """Yields each device that answers on a serial port."""
