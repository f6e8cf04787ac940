"""Common part of drivers that poll a gripper: waits, deadlines, and writes whose answer was lost."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from drivers.clock import Pace
from drivers.errors import GripperFault, LinkTimeout, ReadOnlyError, shown
from drivers.ports import GripperProfile, GripperState, Report, Settled, no_report
from drivers.stream import closed_on_error

ECHO_S = 1.0  # time within which the request is echoed ([SDK] gripper.cpp of Robotiq)
MOVE_MARGIN_S = 2.0  # time beyond stroke / speed: start, contact detection, settling
READINGS = 3  # number of readings in a row that must agree before a width is accepted
WRITE_TRIES = 3  # as Robotiq's SDK: the link is down after 3 failures in a row
Seen = TypeVar("Seen")
Target = TypeVar("Target")


@dataclass(frozen=True, slots=True)
class Move(Generic[Seen, Target]):
    """A requested move, and what `wait` needs to know about it."""

    target: Target  # the request, in the form that the device echoes
    before: Seen  # the last reading before the request
    written_at: float  # wall time of the request
    budget_s: float  # time limit, device seconds
    pause_s: float  # device seconds between two readings of fingers at rest


class ReadOnlyLink:
    """Wraps a link: reads pass through, writes are refused before a frame is built.

    `close` closes the wrapped link.
    """

    def __init__(self, link: Any) -> None:
        self.endpoint = link.endpoint
        self.read, self.close = link.read, link.close

    def write(self, *what: object) -> None:
        """Refuses to write: raises a ReadOnlyError."""
        words = (word.hex() if isinstance(word, bytes) else shown(word) for word in what)
        raise ReadOnlyError(
            f"a dry run was about to write {' '.join(words)} to the gripper at {self.endpoint}"
        )


class PolledGripper(ABC, Generic[Seen, Target]):
    """Base class of drivers that poll a gripper.

    Each make of gripper has a subclass with the methods that know the registers. Every wait has a deadline,
    and every write whose answer was lost is reported.

    Args:
        link: connection to the device; it is closed with the gripper, and also if the first reading fails.
        pace: device time.
        report: receives every retry and failure.
        profile: profile of the expected gripper; None: the usual profile of the make.
        read_only: whether writes are refused.
    """

    # device seconds after a request in which a reading may still belong to the previous move
    stale_s = 0.0
    spread = 0  # largest distance between readings of fingers at rest, in the device's steps

    def __init__(
        self,
        link: Any,
        pace: Pace,
        report: Report = no_report,
        profile: GripperProfile | None = None,
        *,
        read_only: bool = False,
    ) -> None:
        self._link = ReadOnlyLink(link) if read_only else link
        self._pace = pace
        self._report = report
        self._move: Move[Seen, Target] | None = None
        self._asked_at: float | None = None  # start of a move whose readings may be stale
        with closed_on_error(link):
            self.profile = self._begin(profile)

    def state(self) -> GripperState:
        """Reads the gripper, and returns its present state."""
        seen = self._read()
        return self._state(seen, self._target(seen))

    def wait(self) -> Settled:
        """Waits until the last move has ended and the fingers are at rest.

        The device must have received the request, readings must no longer belong to the previous move, and
        `READINGS` readings in a row must report the end of the move at positions that agree within `spread`.

        Raises:
            GripperFault: no move was requested, the request changed, or the move does not settle in time.
        """
        if self._move is None:
            raise GripperFault("no move to wait for; call move() first")
        move, seen = self._move, self._settled()
        target = self._target(seen)
        if target != move.target:
            raise GripperFault(
                "the gripper's request changed during the move; is another program using it?"
            )
        end, seconds = self._state(seen, target), self._pace.elapsed(move.written_at)
        return Settled(end.width_um, end.object, end.current_ma, end.target_um, seconds)

    def close(self) -> None:
        """Closes the link; nothing moves."""
        self._link.close()

    def _budget_s(self, speed_mm_s: float) -> float:
        """Returns the time limit of a move at a speed [s of device time].

        It allows for the whole stroke, since the position at the start may have been misread.
        """
        return self.profile.stroke_um / 1000.0 / speed_mm_s + MOVE_MARGIN_S

    # -- what a make says -------------------------------------------------------------------------

    @abstractmethod
    def _begin(self, profile: GripperProfile | None) -> GripperProfile:
        """Reads the device for the first time; returns the profile of the connected gripper.

        `profile` is the profile of the expected gripper.
        """

    @abstractmethod
    def _read(self) -> Seen:
        """Reads the device."""

    @abstractmethod
    def _target(self, seen: Seen) -> Target:
        """Returns the request that the device echoes in a reading."""

    @abstractmethod
    def _state(self, seen: Seen, target: Target) -> GripperState:
        """Converts a reading, and the target that it echoes, to a state."""

    @abstractmethod
    def _rest(self, seen: Seen, move: Move[Seen, Target]) -> int | None:
        """Returns the position at which a move has ended, in the device's steps.

        It returns None if the move has not ended, or if the reading contradicts itself.
        """

    @abstractmethod
    def _require_ready(self, seen: Seen, doing: str) -> None:
        """Raises a GripperFault unless the gripper may be moved."""

    @abstractmethod
    def _sketch(self, seen: Seen) -> str:
        """Formats a reading for a message."""

    def _received(self, seen: Seen, move: Move[Seen, Target]) -> bool:
        """Whether a reading shows that the device has received the request of a move."""
        return self._target(seen) == move.target

    def _require_obeyed(self, seen: Seen, doing: str) -> None:
        """Raises a GripperFault if a received request is not executed."""
        self._require_ready(seen, doing)

    # -- waiting ----------------------------------------------------------------------------------

    def _checked(self, doing: str) -> Seen:
        seen = self._read()
        self._require_ready(seen, doing)
        return seen

    def _until(
        self,
        done: Callable[[Seen], bool],
        deadline: float,
        doing: str,
        check: Callable[[Seen, str], None] | None = None,
    ) -> Seen:
        """Polls until `done(reading)` is true; returns that reading.

        Raises:
            GripperFault: `check` refused a reading, or the deadline has passed.
        """
        for _ in self._pace.polls(deadline):
            seen = self._read()
            if check is not None:
                check(seen, doing)
            if done(seen):
                return seen
        raise GripperFault(f"gripper not done {doing} in time; last seen {self._sketch(seen)}")

    def _settled(self) -> Seen:
        """Waits until the current move has settled; returns the last reading."""
        assert self._move is not None
        move, self._move = self._move, None
        until, doing = self._pace.deadline(ECHO_S), "taking the request"
        seen = self._until(lambda now: self._received(now, move), until, doing, self._require_ready)
        deadline, late = self._pace.deadline(move.budget_s), 0
        seen = self._past_stale(seen)
        places: list[int] = []
        while True:
            self._require_obeyed(seen, "moving")
            place = self._rest(seen, move)
            places = [] if place is None else [*places, place][-READINGS:]
            if len(places) == READINGS and max(places) - min(places) <= self.spread:
                return seen
            # Fingers at rest are read often enough even if this process was stopped past the
            # deadline.
            if late > READINGS:
                raise GripperFault(
                    "gripper not done moving in time, or its reading does not settle; last seen "
                    f"{self._sketch(seen)}"
                )
            if places:
                self._pace.pause(move.pause_s)
            else:
                self._pace.idle(deadline)
            late += self._pace.now() > deadline
            seen = self._read()

    def _past_stale(self, seen: Seen) -> Seen:
        """Reads until the fingers move, or until `stale_s` after the request; returns the last reading."""
        while self._asked_at is not None and not self._state(seen, self._target(seen)).moving:
            until = self._asked_at + self.stale_s / self._pace.time_scale
            if self._pace.now() >= until:
                break
            self._pace.idle(until)
            seen = self._read()
        self._asked_at = None
        return seen

    def _repeat(self, write: Callable[[], None], arrived: Callable[[], bool]) -> None:
        """Writes until a write is acknowledged, at most `WRITE_TRIES` times; reports each failure.

        Args:
            write: sends the write; raises a LinkTimeout if there is no acknowledgement.
            arrived: returns whether the device echoes the write; raises if a repetition could do harm.

        Raises:
            LinkTimeout: no write was acknowledged.
        """
        for left in reversed(range(WRITE_TRIES)):
            try:
                write()
            except LinkTimeout:
                self._report("link", {"incident": "write unanswered", "arrived": arrived()})
                if not left:
                    raise
            else:
                return


def setting(value: float, ends: tuple[float, float], first: int, last: int) -> int:
    """Returns the greatest setting whose value does not exceed `value`, or else the least setting.

    Args:
        value: the value, in the unit of `ends`.
        ends: values at the settings `first` and `last`; linear in between.
        first: the least setting.
        last: the greatest setting.
    """
    value, least, most = (round(1000 * number) for number in (value, *ends))
    return min(max(first + (value - least) * (last - first) // (most - least), first), last)
