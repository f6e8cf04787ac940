"""What the devices of a cell offer, of any make; a new make is one file of ours, or a package of its own.

A driver satisfies these Protocols without inheriting from them; `drivers.contract` has the tests that every
make passes, and tools/docs/drivers.md says how.

Rules that a type cannot express:

- Connecting reads and never moves anything, and never resets a device that may hold a part.
- Every call ends by a deadline of its own, and a call that fails says so by an error of `drivers.errors`.
- A motion is asked for once. If it is not known whether the request arrived, the state is read before it is
  repeated; after a silence that leaves the state unknown, every further motion is refused.
- `wait` returns a reading that belongs to the last `move` and to no earlier one, or raises.
- `close` moves nothing.
- A device opened with `read_only` sends nothing that could command it: what would is refused in the lowest
  layer that knows a question from a command, by `drivers.errors.ReadOnlyError`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

# x mm, y mm, z mm, angle rad, of the point between the tips
PoseOfHand = tuple[float, float, float, float]
MOST_COUNT = 255  # of a device that tells its widths as counts
# How far a hand, whose gripper nobody named, and what it holds reach from its axis.
TURN_RADIUS_MM = 160.0

# Told of every retry and failure on a link, as kind and fields of a record: a journal's `record` fits.
Report = Callable[[str, Mapping[str, object]], None]


def no_report(kind: str, fields: Mapping[str, object]) -> None:
    """A report nobody reads."""


class ObjectState(IntEnum):
    """What a gripper says about an object between its fingers; a journal holds the number."""

    NONE = 0  # nothing yet: the fingers are on their way, or were never asked to move
    OPENING = 1  # something stopped them while opening
    CLOSING = 2  # something stopped them while closing
    AT_TARGET = 3  # they stand where they were asked to go

    @property
    def sentence(self) -> str:
        """What it says, for a message."""
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True, slots=True)
class GripperProfile:
    """What one model of a gripper can do and tell; its driver knows whatever else is special about it.

    A width is nominal: the distance of the finger faces with the maker's fingers, which a calibration
    corrects (`grasp-calibrate width`). Readings lie on a grid: `steps + 1` widths from 0 to the stroke.
    """

    model: str  # as a job names it
    stroke_um: int  # width of the jaws fully open; closed on nothing they read 0
    resolution_um: float  # step of a reading
    noise_um: int  # standard deviation of a reading, beside its rounding
    speed_mm_s: tuple[float, float]  # rate of the width, slowest and fastest
    force_n: tuple[float, float]  # grip force, weakest and strongest
    held_um: int = 2000  # expected widths from here on are those of a part that is held
    empty_um: int = 5000  # up to this width the object state may miss a part that is held
    streams: bool = False  # whether it takes another width, speed and force while the fingers move
    # link and offset of the arc that the tips move on, mm; a link alone: the offset has to be measured;
    # empty: they move straight
    arc_mm: tuple[float, ...] = ()
    # Usual fingertips: along x, and along y as they close.
    fingers_mm: tuple[float, float] = (25.0, 10.0)
    # What the device reads open and closed, if it counts from 0 to `MOST_COUNT`.
    counts: tuple[int, int] | None = None
    # How far it reaches from its axis, jaws open, its maker's fingers included.
    radius_mm: float = TURN_RADIUS_MM

    @property
    def steps(self) -> int:
        """Number of steps of the grid of readings."""
        return round(self.stroke_um / self.resolution_um)

    def reading_um(self, step: int) -> int:
        """The width at a step of the grid, from 0, rounded; steps beyond the ends go on alike."""
        return (2 * self.stroke_um * step + self.steps) // (2 * self.steps)

    def step(self, width_um: float) -> int:
        """The step of the grid nearest to a width."""
        return round(width_um * self.steps / self.stroke_um)

    def counted_um(self, count: int) -> int:
        """The width at a count of a device that counts; beyond its end counts widths go on alike."""
        assert self.counts is not None
        return self.reading_um(self.counts[1] - count)


@dataclass(frozen=True, slots=True)
class GripperState:
    """One reading. Widths are nominal, see `GripperProfile`."""

    activated: bool  # whether it may be moved
    moving: bool  # whether the fingers are on their way
    fault: int  # the device's fault word; 0 where nothing keeps it from being moved
    fault_text: str  # what that means and what to do, a sentence; empty without a fault
    object: ObjectState
    # the requested width as the device repeats it, up to the stroke; after a new connection too. What closes
    # the fingers as far as they go is repeated as below 0 by a device that can, else as 0.
    target_um: int
    # where the fingers are; a little below 0 or above the stroke where they go beyond the nominal ends
    width_um: int
    current_ma: int  # motor current; 0 where the device does not tell


class Settled(NamedTuple):
    """How a move ended: all of it from readings after the fingers came to rest."""

    width_um: int  # where the fingers rest
    object: ObjectState  # never `NONE`
    current_ma: int  # motor current
    target_um: int  # the request this reading belongs to
    seconds: float  # device seconds since the move was asked for


@runtime_checkable
class Gripper(Protocol):
    """A parallel-jaw gripper."""

    @property
    def profile(self) -> GripperProfile:
        """What its model can do and tell."""

    def state(self) -> GripperState:
        """Read it now.

        Raises:
            LinkError: it cannot be reached.
        """

    def activate(self) -> None:
        """Make it ready to move; the fingers may sweep. Nothing if it is ready already.

        Raises:
            GripperFault: it cannot be made ready.
        """

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Ask for a width of the grid, and return at once.

        Below 0 the fingers close, at the stroke they open as far as they go. Speed and force are the
        greatest that the device can be asked for without exceeding the argument, but at least its least.

        Raises:
            GripperFault: it is not ready, or reports a fault.
        """

    def wait(self) -> Settled:
        """Wait until the last move has settled.

        Raises:
            GripperFault: it does not settle in time, or the reading cannot be trusted.
        """

    def stop(self) -> None:
        """Stop the fingers where they are, on the way of `activate`, too; what they hold stays held."""

    def close(self) -> None:
        """Give the link up."""


@runtime_checkable
class Arm(Protocol):
    """An arm that places the point midway between the finger tips, hand pointing down."""

    def pose(self) -> PoseOfHand:
        """Read where it is; the angle counts whole turns of the wrist.

        Raises:
            ArmError: it is silent, or its hand does not point down.
        """

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Least and greatest angle that the hand can be turned to at a place, rad; may be infinite.

        Raises:
            ArmError: it is silent, or its wrist does not stand as counted.
        """

    def obstacle(self, start: PoseOfHand, target: PoseOfHand) -> str:
        """Why a straight way cannot be gone, as far as that is known beforehand; empty where nothing is."""

    def move_linear(
        self,
        x_mm: float,
        y_mm: float,
        z_mm: float,
        angle_rad: float,
        speed_mm_s: float,
        radius_mm: float = TURN_RADIUS_MM,
    ) -> None:
        """Move in a straight line and return when it stands there.

        The angle is taken as it is counted, not the shortest way; half a turn or more, whose way an arm may
        not be able to choose, is asked for in several motions. A turn counts as the way of a point
        `radius_mm` off the hand's axis: nothing so near to the axis moves faster than asked.

        Raises:
            ArmError: refused before anything was sent, or its state is unknown from now on.
        """

    def close(self) -> None:
        """Give the link up."""


class Truth(NamedTuple):
    """What only a simulated cell knows of its part."""

    x_mm: float  # its pose in the world; NaN where the cell's world has none
    y_mm: float
    theta_rad: float
    squeezes: int  # how often it was squeezed
    crashes: int  # times open fingers were placed onto it
    status: str  # what the last squeeze came to
    covered: bool = False  # whether a camera would see nothing
    hypothesis: int = 0  # which of the table's parts it is


class Scene(Protocol):
    """Stand-in for the feeder, and ground truth; only a simulated cell has one."""

    def next_part(self) -> int:
        """Take the part away, bring the next and return its number."""

    def truth(self) -> Truth:
        """Read where the part really lies."""

    def close(self) -> None:
        """Give the link up."""


class Answered(NamedTuple):
    """Who answered a scan: slave id and baud rate."""

    unit: int
    baud: int


class Drivers(Protocol):
    """What opens devices; `drivers.connect`, which says what the addresses are."""

    def gripper(
        self,
        port: str,
        profile: GripperProfile | None = None,
        *,
        time_scale: float = 1.0,
        read_only: bool = False,
        report: Report = ...,
    ) -> Gripper:
        """Connect to a gripper, moving nothing; `profile` is that of the gripper that should be there."""

    def arm(self, url: str, *, time_scale: float = 1.0, read_only: bool = False) -> Arm:
        """Connect to an arm, moving nothing."""

    def scene(self, url: str) -> Scene:
        """Connect to a simulated cell's scene."""

    def virtual(self, tree: Path, *, world: str, seed: int, report: Report = ...) -> Any:
        """A simulated cell in this process, in virtual time: gripper, arm, scene and clock."""

    def scan(self, port: str) -> Iterator[Answered]:
        """Who answers on a serial port."""
