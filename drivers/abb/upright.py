"""Base class of drivers for arms whose hand points straight down: checks motions and counts whole turns.

A controller receives rotations in a form in which whole turns make no difference (a quaternion, say), and
turns the shortest way. So the driver counts the hand's whole turns from motion to motion, and checks the
count against the angle of the last axis.
"""

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeVar

from drivers.abb import codec
from drivers.abb.codec import Pose, ProtocolError
from drivers.abb.reach import Setup, Wrist, obstacle, within_irb_120
from drivers.clock import Pace
from drivers.errors import ArmError, ReadOnlyError
from drivers.ports import TURN_RADIUS_MM, PoseOfHand

MOVE_MARGIN_S = 3.0  # acceleration, fine point, network
# Largest turn in one motion: the controller turns the shortest way, which is ambiguous at half a turn.
MOST_TURN_RAD = 3.0
Read = TypeVar("Read")


class ArmPose(NamedTuple):
    """Pose of the hand in the work object frame: mm, and angle about the vertical, whole turns counted."""

    x_mm: float
    y_mm: float
    z_mm: float
    angle_rad: float

    @property
    def frame(self) -> Pose:
        """The same pose with a quaternion; the hand points down."""
        return Pose(self.x_mm, self.y_mm, self.z_mm, codec.hand_rotation(self.angle_rad))


class Motion(NamedTuple):
    """A straight motion that has passed all checks."""

    start: ArmPose
    target: ArmPose
    speed_mm_s: float  # greatest speed of the point between the finger tips
    turn_rad_s: float  # greatest rate at which the hand turns
    budget_s: float  # time limit, in device seconds


class UprightArm(ABC):
    """Base class of drivers for arms whose hand points down.

    Each make of arm has a subclass with the methods that read and move the arm.

    Args:
        endpoint: address of the arm as the user named it.
        link: the connection to the controller; `close` closes it.
        pace: device time.
        setup: frames and limits.
        reaches: says whether the flange can be at a pose in the base frame.
    """

    look_at = "the pendant"  # where an operator looks for the arm's state once it is unknown

    def __init__(
        self,
        endpoint: str,
        link: Any,
        pace: Pace,
        setup: Setup,
        reaches: Callable[[Pose], bool] = within_irb_120,
    ) -> None:
        self.endpoint = endpoint
        self._link = link
        self._pace = pace
        self._setup = setup
        self._reaches = reaches
        self._unknown = ""  # why the state is unknown; empty: it is known
        self._at: ArmPose | None = None  # None: unknown, has to be read
        self._angle_rad: float | None = None  # the last known angle, from which the next is counted
        self._wrist: Wrist | None = None
        self._wrist_is_fresh = False

    def close(self) -> None:
        """Closes the link; the arm does not move."""
        self._unknown = self._unknown or "it was closed"
        self._link.close()

    @abstractmethod
    def _read_hand(self) -> Pose:
        """Reads the hand's current pose in the work object frame.

        Raises:
            ArmError: the arm is silent, or its state unknown.
            ProtocolError: the arm's answer is invalid.
        """

    @abstractmethod
    def _read_last_axis(self) -> float:
        """Reads the last joint in rad, whole turns included; raises the errors of `_read_hand`."""

    @abstractmethod
    def _drive(self, motion: Motion) -> None:
        """Moves the hand straight to the target, and returns when it is at rest.

        Raises:
            ArmError: the motion was refused before it began; or the hand did not arrive in time, and the
                arm's state is unknown.
        """

    def pose(self) -> ArmPose:
        """Reads the hand's pose."""
        x_mm, y_mm, z_mm, rotation = self._understood(self._read_hand)
        angle_rad = self._understood(lambda: codec.hand_angle(rotation))
        if self._angle_rad is None:
            # Counted so that axis 6 near its middle gives angles near zero; the joints give the
            # whole turns.
            whole_rad = angle_rad + self._understood(self._read_last_axis)
            turns = math.tau * math.floor((1.5 * math.pi - whole_rad) / math.tau)
            self._wrist = Wrist(whole_rad + turns, x_mm, y_mm)
            self._angle_rad, self._wrist_is_fresh = angle_rad + turns, True
        else:
            self._angle_rad += math.remainder(angle_rad - self._angle_rad, math.tau)
        self._at = ArmPose(x_mm, y_mm, z_mm, self._angle_rad)
        return self._at

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Least and greatest angle of the hand that the wrist allows at a place, whole turns counted, rad.

        Reads the joints if the arm has moved since their last reading.
        """
        here, counted = self._at or self.pose(), self._wrist
        assert counted is not None  # since the first pose
        if not self._wrist_is_fresh:
            last_rad = self._understood(self._read_last_axis)
            seen = Wrist(here.angle_rad + last_rad, here.x_mm, here.y_mm)
            if abs(counted.moved(here.x_mm, here.y_mm, self._setup) - seen.whole_rad) > math.pi:
                raise ArmError(
                    f"arm at {self.endpoint}: the wrist stands whole turns off what was counted; find out "
                    "who else moves the arm, then connect again"
                )
            self._wrist, self._wrist_is_fresh, counted = seen, True, seen
        return counted.turn_range(x_mm, y_mm, self._setup)

    def obstacle(self, start: PoseOfHand, target: PoseOfHand) -> str:
        """Returns why a straight motion is impossible; empty if no reason is known."""
        return obstacle(ArmPose(*start).frame, ArmPose(*target).frame, self._setup, self._reaches)

    def move_linear(
        self, target: PoseOfHand, speed_mm_s: float, radius_mm: float = TURN_RADIUS_MM
    ) -> None:
        """Moves the hand, pointing down, in a straight line and returns when it is at rest (`ports.Arm`).

        Sends nothing if the target is invalid or out of reach. If the arm does not arrive in time, its
        state is unknown, and every further call is refused.
        """
        end = ArmPose(*target)
        try:
            codec.pose_numbers(end.frame)
        except (ProtocolError, ValueError) as error:
            raise ArmError(f"arm not moved: {error}") from error
        start = self._at or self.pose()
        if reason := self.obstacle(start, end) or self._overturn(start, end):
            message = f"({end.x_mm:.1f}, {end.y_mm:.1f}, {end.z_mm:.1f}) mm"
            raise ArmError(f"arm not moved: the way to {message} is {reason}")
        if not (speed_mm_s > 0.0 and radius_mm > 0.0):
            raise ArmError(
                f"arm speed {speed_mm_s} mm/s at a radius of {radius_mm} mm; both must be positive"
            )
        turn_rad_s = speed_mm_s / radius_mm
        try:
            codec.speed_numbers(speed_mm_s, turn_rad_s)
        except ProtocolError as error:
            raise ArmError(f"arm speed: {error}") from error
        if self._setup.read_only:
            raise ReadOnlyError(f"a dry run was about to move the arm at {self.endpoint}")
        self._at, self._wrist_is_fresh = None, False
        turn_rad = abs(end.angle_rad - start.angle_rad)
        travel_s = max(math.dist(start[:3], end[:3]), radius_mm * turn_rad) / speed_mm_s
        budget_s = travel_s * 1.5 + MOVE_MARGIN_S
        self._drive(Motion(start, end, speed_mm_s, turn_rad_s, budget_s))
        self._at, self._angle_rad = end, end.angle_rad

    def _overturn(self, start: ArmPose, target: ArmPose) -> str:
        """Returns why the hand cannot turn to the target; empty if it can.

        A hand that starts outside the range of the wrist may turn towards the range.
        """
        if abs(target.angle_rad - start.angle_rad) > MOST_TURN_RAD:
            return "half a turn or more, which the controller may go either way; go it in several motions"
        assert self._wrist is not None  # since the first pose
        low, high = self._wrist.turn_range(target.x_mm, target.y_mm, self._setup)
        if min(low, start.angle_rad) <= target.angle_rad <= max(high, start.angle_rad):
            return ""
        least, most = self._setup.wrist
        return f"farther round than the wrist turns ({least:g} to {most:g} deg)"

    def _check_known(self) -> None:
        if self._unknown:
            raise ArmError(
                f"arm at {self.endpoint}: state unknown since {self._unknown}; "
                "look at the arm, then connect again"
            )

    def _lose(self, reason: str, kind: type[ArmError] = ArmError) -> ArmError:
        """Marks the arm's state as permanently unknown; returns the error for the caller to raise."""
        self._unknown = reason
        return kind(
            f"arm at {self.endpoint} lost, its state is unknown: {reason}; look at {self.look_at}"
        )

    @contextlib.contextmanager
    def _stopped_on_error(self, stop: Callable[[], None]) -> Iterator[None]:
        """Context of a motion: any error, also Ctrl-C, calls `stop` and makes the arm's state unknown."""
        try:
            yield
        except BaseException as error:
            with contextlib.suppress(OSError):
                stop()
            if isinstance(error, OSError) and not isinstance(error, ArmError):
                raise self._lose(str(error)) from error
            self._unknown = self._unknown or "a motion was interrupted"
            raise

    def _understood(self, read: Callable[[], Read]) -> Read:
        try:
            return read()
        except ProtocolError as error:
            raise ArmError(f"arm at {self.endpoint}: {error}") from error
