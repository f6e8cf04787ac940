"""Device logic of a DH gripper: initialisation, moves, and telling a finished move from a stale state.

The registers have no stop, no fault and no current; [PGC] and [PGE] as in `drivers.dh.registers`.
"""

from collections.abc import Callable
from typing import NamedTuple
from urllib.parse import parse_qsl

from drivers.clock import Pace
from drivers.dh import registers as dh
from drivers.dh.link import Link, ReadOnlyLink, RtuLink
from drivers.dh.percent import Scale
from drivers.dh.registers import Grip, Initialised
from drivers.errors import GripperFault, LinkTimeout, PortError
from drivers.links import no_report
from drivers.ports import GripperProfile, GripperState, ObjectState, Report, Settled
from drivers.stream import SerialStream, Stream, open_tcp, tcp_address

INITIALISE_S = 10.0  # a stroke at a speed that no manual states
ECHO_S = 1.0  # the position asked for reads back within this
STALE_S = 0.2  # how long the grip state may still be that of the previous move
MOVE_MARGIN_S = 2.0  # beyond stroke / speed: start, contact detection, settling
REST_S = 1.0  # fingers that were stopped stand within this
EQUAL_READINGS = 3  # in a row before a position is believed
ARRIVED = (
    10  # positions: a state of "at position" farther than this from the request contradicts it
)
WRITE_TRIES = 3


class Reading(NamedTuple):
    """One reading of all registers that tell something."""

    initialised: Initialised
    grip: Grip
    position: int
    target: int  # position asked for
    settings: dict[int, int]  # what the control registers hold

    @property
    def ready(self) -> bool:
        """Whether it may be moved."""
        return self.initialised is Initialised.YES

    @property
    def moving(self) -> bool:
        """Whether the fingers are on their way."""
        if self.ready:
            return self.grip is Grip.MOVING
        return self.initialised is Initialised.IN_PROGRESS

    @property
    def object(self) -> ObjectState:
        """What it says about an object; the registers do not tell in which direction it was met."""
        if not self.ready or self.moving:
            return ObjectState.NONE
        if self.grip is not Grip.CAUGHT:
            return ObjectState.AT_TARGET
        return ObjectState.CLOSING if self.target < self.position else ObjectState.OPENING


class _Move(NamedTuple):
    target: int
    start: int
    written_at: float
    budget_s: float
    settle_s: float  # between two readings of fingers at rest


class Gripper:
    """A DH gripper. Connecting reads and never writes; every wait has a deadline.

    Every write whose answer was lost is reported.
    """

    def __init__(
        self,
        link: Link,
        pace: Pace,
        report: Report = no_report,
        profile: GripperProfile | None = None,
    ) -> None:
        self._scale = Scale(profile)
        self._link = link
        self._pace = pace
        self._report = report
        self._move: _Move | None = None
        self._asked_at: float | None = None  # when a position was last written
        self._read()

    @property
    def profile(self) -> GripperProfile:
        """What its model can do and tell."""
        return self._scale.profile

    def state(self) -> GripperState:
        """Read the gripper now."""
        seen = self._read()
        return GripperState(
            activated=seen.ready,
            moving=seen.moving,
            fault=0,
            fault_text="",
            object=seen.object,
            target_um=self._scale.width_um(seen.target),
            width_um=self._scale.width_um(seen.position),
            current_ma=0,
        )

    def activate(self) -> None:
        """Initialise: the fingers open, or close if the gripper is set so; what they hold is dropped.

        The stroke is not learnt anew: that closes the fingers, on whatever is between them, and is done once
        after a change of fingers, with the maker's software.
        """
        seen = self._read()
        if seen.ready:
            return
        deadline = self._pace.deadline(INITIALISE_S)
        if seen.initialised is Initialised.NO:
            self._write(
                dh.INITIALISATION, dh.INITIALISE, lambda now: now.initialised is not Initialised.NO
            )
        self._until(lambda now: now.ready, deadline, "initialising")

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Ask for a width, at a speed and with a force; `wait` tells how it ended."""
        self._move = None
        seen = self._checked("asked to move")
        target, speed = self._scale.position(width_um), self._scale.speed(speed_mm_s)
        for register, value in ((dh.FORCE, self._scale.force(force_n)), (dh.SPEED, speed)):
            if seen.settings[register] != value:
                self._set(register, value)
        rate_mm_s = self._scale.speed_mm_s(speed)
        mm_per_step = self.profile.resolution_um / 1000.0
        budget_s = abs(target - seen.position) * mm_per_step / rate_mm_s + MOVE_MARGIN_S
        self._ask(target)
        self._move = _Move(
            target, seen.position, self._pace.now(), budget_s, mm_per_step / rate_mm_s
        )

    def wait(self) -> Settled:
        """Wait until the last move has ended and the position stands still.

        The position asked for reads back; the grip state had its chance to say that they move (it may follow
        late, and a short move may never show it); it says so no longer; three readings in a row give one
        position that it does not contradict.
        """
        if self._move is None:
            raise GripperFault("no move to wait for; call move() first")
        move, self._move = self._move, None
        deadline = self._pace.deadline(ECHO_S)
        self._until(
            lambda now: now.target == move.target, deadline, "taking the request", _require_ready
        )
        deadline = self._pace.deadline(move.budget_s)
        self._past_stale()
        seen = self._until(lambda now: not now.moving, deadline, "moving", _require_ready)
        seen = self._steady(seen, move, deadline)
        if seen.target != move.target:
            raise GripperFault(
                "the gripper's request changed during the move; is another program using it?"
            )
        return Settled(
            self._scale.width_um(seen.position),
            seen.object,
            0,
            self._scale.width_um(seen.target),
            self._pace.elapsed(move.written_at),
        )

    def stop(self) -> None:
        """Stop the fingers by asking for where they are; what they hold stays held.

        Raises:
            GripperFault: it initialises, which no register ends, or does not come to rest.
        """
        self._move = None
        seen = self._past_stale()
        if seen.initialised is Initialised.IN_PROGRESS:
            raise GripperFault(
                "the gripper cannot be stopped while it initialises; cut its supply if it must be"
            )
        # Fingers that hold something stand, and press on because they are not where they were asked to be.
        if not seen.ready or seen.grip is Grip.CAUGHT:
            return
        self._ask(seen.position)
        deadline = self._pace.deadline(REST_S)
        self._past_stale()
        self._until(lambda now: not now.moving, deadline, "stopping")

    def close(self) -> None:
        """Close the link; nothing moves."""
        self._link.close()

    def _read(self) -> Reading:
        words = self._link.read()
        try:
            return Reading(
                Initialised(words[dh.INITIALISED]),
                Grip(words[dh.GRIP]),
                words[dh.ACTUAL_POSITION],
                words[dh.POSITION],
                dict(words),
            )
        except ValueError as error:
            raise GripperFault(
                f"gripper at {self._link.endpoint} is in no state that a DH gripper has ({error}); "
                "check that it is one"
            ) from error

    def _checked(self, doing: str) -> Reading:
        seen = self._read()
        _require_ready(seen, doing)
        return seen

    def _ask(self, target: int) -> None:
        self._asked_at = self._pace.now()
        self._set(dh.POSITION, target)

    def _set(self, register: int, value: int) -> None:
        self._write(register, value, lambda now: now.settings[register] == value, _require_ready)

    def _write(
        self,
        register: int,
        value: int,
        arrived: Callable[[Reading], bool],
        check: Callable[[Reading, str], None] | None = None,
    ) -> None:
        """Write a register until it is acknowledged; before each repetition see whether it `arrived`.

        A position that is written once more while the fingers are on their way to it changes nothing.
        """
        for attempt in range(1, WRITE_TRIES + 1):
            try:
                self._link.write(register, value)
            except LinkTimeout:
                seen = self._read()
                self._report("link", {"incident": "write unanswered", "arrived": arrived(seen)})
                if check is not None:
                    check(seen, "repeating a write whose answer was lost")
                if attempt == WRITE_TRIES and not arrived(seen):
                    raise
            else:
                return

    def _past_stale(self) -> Reading:
        """Read until the grip state is that of the last request, and no earlier one."""
        seen = self._read()
        while self._asked_at is not None and not seen.moving:
            stale_until = self._asked_at + STALE_S / self._pace.time_scale
            if self._pace.now() >= stale_until:
                break
            self._pace.idle(stale_until)
            seen = self._read()
        self._asked_at = None
        return seen

    def _until(
        self,
        done: Callable[[Reading], bool],
        deadline: float,
        doing: str,
        check: Callable[[Reading, str], None] | None = None,
    ) -> Reading:
        """Poll until `done`, a state that `check` refuses, or the deadline."""
        while True:
            late = self._pace.now() > deadline
            seen = self._read()
            if check is not None:
                check(seen, doing)
            if done(seen):
                return seen
            if late:
                raise GripperFault(f"gripper not done {doing} in time; last seen {_sketch(seen)}")
            self._pace.idle(deadline)

    def _steady(self, seen: Reading, move: _Move, deadline: float) -> Reading:
        """Read until the position has been the same three times in a row, and agrees with the grip state."""
        equal, late = 1, 0
        while equal < EQUAL_READINGS or not _agrees(seen, move):
            # Fingers that rest are read often enough even if this process was stopped past the deadline.
            late += self._pace.now() > deadline
            if late > EQUAL_READINGS:
                raise GripperFault(f"gripper does not settle; last seen {_sketch(seen)}")
            if equal < EQUAL_READINGS:
                self._pace.pause(move.settle_s)
            else:
                self._pace.idle(deadline)
            last, seen = seen, self._checked("settling")
            equal = equal + 1 if seen.position == last.position and not seen.moving else 1
        return seen


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> Gripper:
    """A DH gripper at `dh:///dev/ttyUSB0`, or at `dh://host:port` behind a serial device server; `?unit=2`.

    Raises:
        PortError: the port cannot be opened or is not understood, or the profile is of another make.
    """
    address, _, settings = port.partition("?")
    unit = _unit_of(port, settings)
    Scale(profile)  # before anything is opened
    path = address.removeprefix("dh://")
    stream: Stream
    if path.startswith("/"):
        stream = SerialStream(path, dh.BAUD)
    else:
        stream = open_tcp(*tcp_address(address), port, "check address, cable and power")
    link = RtuLink(stream, pace, report, unit)
    try:
        return Gripper(ReadOnlyLink(link) if read_only else link, pace, report, profile)
    except BaseException:  # Ctrl-C, too, must not leave the port open
        link.close()
        raise


def _unit_of(port: str, settings: str) -> int:
    stated = parse_qsl(settings, keep_blank_values=True) or [("unit", str(dh.UNIT))]
    if len(stated) > 1 or stated[0][0] != "unit" or not stated[0][1].isdecimal():
        raise PortError(f"port {port} is not understood; write it as dh:///dev/ttyUSB0?unit=1")
    if not 1 <= (unit := int(stated[0][1])) <= 247:
        raise PortError(f"port {port}: a unit is 1 to 247")
    return unit


def _agrees(seen: Reading, move: _Move) -> bool:
    """Whether the grip state fits the position: a stale one mostly does not."""
    if seen.grip is not Grip.CAUGHT:
        return abs(seen.position - move.target) <= ARRIVED
    closing = move.target < seen.position
    return move.target == move.start or closing == (move.target < move.start)


def _require_ready(seen: Reading, doing: str) -> None:
    if not seen.ready:
        raise GripperFault(
            f"gripper not active while {doing}, it is not initialised; clear the fingers and activate it "
            "(--activate)"
        )


def _sketch(seen: Reading) -> str:
    return f"{seen.initialised.name}, {seen.grip.name}, position {seen.position}, request {seen.target}"
