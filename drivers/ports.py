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
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

PoseOfHand = tuple[
    float, float, float, float
]  # x mm, y mm, z mm, angle rad, of the point between the tips
TURN_RADIUS_MM = (
    160.0  # how far a hand, whose gripper nobody named, and what it holds reach from its axis
)

# Told of every retry and failure on a link, as kind and fields of a record: a journal's `record` fits.
Report = Callable[[str, Mapping[str, object]], None]


@dataclass(frozen=True, slots=True)
class GripperState:
    """One reading. Positions are counts of 0 (open) to 255 (closed), whatever the device counts in."""

    activated: bool  # whether it may be moved
    moving: bool  # whether the fingers are on their way
    fault: int  # 0, or the fault's code (`drivers.errors.FAULTS`)
    # 0 moving, 1 contact while opening, 2 contact while closing, 3 at the requested position
    object_flag: int
    echo_counts: int  # the requested position as the device repeats it
    position_counts: int  # where the fingers are
    current_ma: int  # motor current; 0 where the device does not tell


class Settled(NamedTuple):
    """How a move ended: all of it from readings after the fingers came to rest."""

    position_counts: int  # where the fingers rest
    object_flag: (
        int  # 1 contact while opening, 2 contact while closing, 3 at the requested position
    )
    current_ma: int  # motor current
    echo_counts: int  # the request this reading belongs to
    seconds: float  # device seconds since the move was asked for


@runtime_checkable
class Gripper(Protocol):
    """A parallel-jaw gripper."""

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

    def move(self, position_counts: int, speed_counts: int, force_counts: int) -> None:
        """Ask for a position, each setting 0 to 255, and return at once.

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
        self, port: str, *, time_scale: float = 1.0, read_only: bool = False, report: Report = ...
    ) -> Gripper:
        """Connect to a gripper, moving nothing."""

    def arm(self, url: str, *, time_scale: float = 1.0, read_only: bool = False) -> Arm:
        """Connect to an arm, moving nothing."""

    def scene(self, url: str) -> Scene:
        """Connect to a simulated cell's scene."""

    def virtual(self, tree: Path, *, world: str, seed: int, report: Report = ...) -> Any:
        """A simulated cell in this process, in virtual time: gripper, arm, scene and clock."""

    def scan(self, port: str) -> Iterator[Answered]:
        """Who answers on a serial port."""
