"""Device logic of a Robotiq 2F gripper: activation, moves, and telling a finished move from a stale flag.

After the 2F-85 manual ([M18] p54-62) and Robotiq's own SDK (`gripper.cpp`, `gripper_state.cpp`).
"""

from collections.abc import Callable
from typing import NamedTuple

from drivers.clock import Pace
from drivers.errors import GripperFault, LinkTimeout
from drivers.links import no_report
from drivers.ports import GripperProfile, GripperState, ObjectState, Report, Settled
from drivers.robotiq.counts import Counts
from drivers.robotiq.faults import MAJOR, PRIORITY, fault, fault_text
from drivers.robotiq.link import Link, ReadOnlyLink
from drivers.robotiq.registers import (
    COUNT_CLOSED,
    COUNT_OPEN,
    OBJ_AT_REQUEST,
    OBJ_CONTACT_CLOSING,
    OPENING_MM,
    OUTPUT_FIELDS,
    Reading,
    decode,
    pack,
    speed_mm_s_of,
)

ACTIVATION_S = (
    15.0  # reset, sweep and report, all told ([SDK] gripper.cpp; 5 s was too short for some)
)
ECHO_S = 1.0  # gPR must echo rPR within this ([SDK] gripper.cpp)
STALE_FLAG_S = 0.2  # how long gOBJ may still tell of the previous move ([SDK] gripper.cpp)
MOVE_MARGIN_S = 2.0  # beyond stroke / speed: start, contact detection, settling
EQUAL_COUNTS = 3  # readings in a row with one count before a width is believed
SETTLE_COUNTS = 1.0  # between them: as long as jaws at the speed asked for take for so many counts
ARRIVED_COUNTS = (
    12  # gOBJ 3 farther than this from the request contradicts the count (open ends at 3 to 13)
)
COMM_SILENCE = 0x09
WRITE_TRIES = 3  # as the SDK: the link is down after 3 failures in a row


class _Move(NamedTuple):
    position_counts: int
    start_counts: int
    written_at: float
    budget_s: float
    settle_s: float  # between two readings of jaws at rest


class Gripper:
    """A Robotiq 2F gripper. Connecting reads and never writes; every wait has a deadline.

    Every write whose answer was lost is reported.
    """

    def __init__(
        self,
        link: Link,
        pace: Pace,
        report: Report = no_report,
        profile: GripperProfile | None = None,
    ) -> None:
        self._counts = Counts(profile)
        self._link = link
        self._pace = pace
        self._report = report
        self._move: _Move | None = None
        # Seeded from what the gripper does now, so that the first write cannot move a holding gripper.
        seen = self._read()
        self._image = {"rACT": int(seen.enabled), "rGTO": int(seen.going), "rPR": seen.echo_counts}

    @property
    def profile(self) -> GripperProfile:
        """What its model can do and tell."""
        return self._counts.profile

    def state(self) -> GripperState:
        """Read the gripper now."""
        seen = self._read()
        # Of the silence before this request it is only known that it is over.
        code = 0 if seen.fault == COMM_SILENCE else seen.fault
        text = fault_text(code) if code else None
        return GripperState(
            activated=seen.activated,
            moving=seen.moving,
            fault=code,
            fault_text="" if text is None else f"0x{code:02X}, {text.sentence}; {text.remedy}",
            object=ObjectState(seen.object_flag),
            target_um=self._counts.target_um(seen.echo_counts),
            width_um=self._counts.width_um(seen.position_counts),
            current_ma=seen.current_ma,
        )

    def _read(self) -> Reading:
        seen = decode(self._link.read())
        if seen.fault == COMM_SILENCE:
            # Fault 9 tells of the silence before this very request; the next reading tells of now.
            seen = decode(self._link.read())
        return seen

    def activate(self) -> None:
        """Reset and activate: the jaws sweep fully open and closed, whatever they hold is dropped.

        The reset clears a latched fault. A gripper that is active and has none is left alone.
        """
        seen = self._read()
        if seen.activated and not _has_latched(seen):
            return
        deadline = self._pace.deadline(ACTIVATION_S)
        if _has_latched(seen) or not seen.activating:
            self._send({})
            self._until(lambda now: not now.enabled, deadline, "resetting")
            self._send({"rACT": 1})
        self._until(lambda now: now.activated, deadline, "activating", _refuse_latched)

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Ask for a width (rPR), at a speed (rSP) and with a force (rFR); `wait` tells how it ended."""
        self._move = None
        seen = self._read()
        _require_ready(seen, "asked to move")
        counts = self._counts.request(width_um)
        setting = self._counts.speed(speed_mm_s)
        request = {
            "rACT": 1,
            "rGTO": 1,
            "rPR": counts,
            "rSP": setting,
            "rFR": self._counts.force(force_n),
        }
        mm_per_count = OPENING_MM / (COUNT_CLOSED - COUNT_OPEN)
        stroke_mm = abs(counts - seen.position_counts) * mm_per_count
        budget_s = stroke_mm / speed_mm_s_of(setting) + MOVE_MARGIN_S
        self._send(request)
        settle_s = SETTLE_COUNTS * mm_per_count / speed_mm_s_of(setting)
        self._move = _Move(counts, seen.position_counts, self._pace.now(), budget_s, settle_s)

    def wait(self) -> Settled:
        """Wait until the last move has ended and the count stands still.

        In the SDK's order: gPR echoes the request; gOBJ had its chance to drop to 0 (it can lag the echo,
        and a short move may never show it); gOBJ is no longer 0; three readings in a row give one count that
        gOBJ does not contradict.
        """
        if self._move is None:
            raise GripperFault("no move to wait for; call move() first")
        move, self._move = self._move, None
        deadline = self._pace.deadline(ECHO_S)
        asked = move.position_counts
        seen = self._until(
            lambda now: now.echo_counts == asked, deadline, "taking the request", _require_ready
        )
        _require_ready(seen, "moving")
        stale_until = move.written_at + STALE_FLAG_S / self._pace.time_scale
        deadline = self._pace.deadline(move.budget_s)
        while not seen.moving and self._pace.now() < stale_until:
            self._pace.idle(stale_until)
            seen = self._checked("moving")
        if seen.moving or not seen.going:
            seen = self._until(
                lambda now: now.going and not now.moving, deadline, "moving", _require_ready
            )
        seen = self._steady(seen, move, deadline)
        if seen.echo_counts != asked:
            raise GripperFault(
                "the gripper's request changed during the move; is another program using it?"
            )
        seconds = self._pace.elapsed(move.written_at)
        return Settled(
            self._counts.width_um(seen.position_counts),
            ObjectState(seen.object_flag),
            seen.current_ma,
            self._counts.target_um(seen.echo_counts),
            seconds,
        )

    def stop(self) -> None:
        """Stop the jaws where they are; the request stays, a held part stays held. An activation is reset."""
        self._move = None
        seen = self._read()
        if seen.activating or (seen.enabled and not seen.activated and not seen.fault):
            self._send({})  # the sweep does not ask for rGTO, only for rACT ([M18] p54)
        # Writing rACT to a gripper that lost power would start the activation sweep; it does not move anyway.
        elif seen.enabled:
            self._send({**self._image, "rACT": 1, "rGTO": 0, "rPR": seen.echo_counts})

    def close(self) -> None:
        """Close the link; nothing moves."""
        self._link.close()

    def _send(self, image: dict[str, int]) -> None:
        """Write the command image, again and again until one write is acknowledged.

        Speed and force are not echoed, so only the answer to the write tells that they arrived. The same
        block once more changes nothing, unless the gripper is no longer active: then it is a fault.
        """
        block = pack(OUTPUT_FIELDS, image)
        for attempt in range(1, WRITE_TRIES + 1):
            try:
                self._link.write(block)
                break
            except LinkTimeout:
                arrived = self._arrived(image)
                self._report("link", {"incident": "write unanswered", "arrived": arrived})
                if attempt == WRITE_TRIES:
                    raise
        self._image = image

    def _arrived(self, image: dict[str, int]) -> bool:
        """Whether the echoes tell that it arrived; looked at before the block is written once more."""
        seen = self._read()
        sweeps = not seen.enabled and self._image.get("rACT") == image.get("rACT") == 1
        if (
            image.get("rGTO") == 1 or sweeps
        ):  # rACT set in a gripper that lost power starts the sweep
            _require_ready(seen, "repeating a write whose answer was lost")
        wanted = (image.get("rACT", 0) == 1, image.get("rGTO", 0) == 1, image.get("rPR", 0))
        return (seen.enabled, seen.going, seen.echo_counts) == wanted

    def _checked(self, doing: str) -> Reading:
        seen = self._read()
        _require_ready(seen, doing)
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
            if done(seen):
                return seen
            if check is not None:
                check(seen, doing)
            if late:
                raise GripperFault(f"gripper not done {doing} in time; last seen {_sketch(seen)}")
            self._pace.idle(deadline)

    def _steady(self, seen: Reading, move: _Move, deadline: float) -> Reading:
        """Read until the count has been the same three times in a row, and agrees with gOBJ."""
        equal, late = 1, 0
        while equal < EQUAL_COUNTS or not _agrees(seen, move.position_counts, move.start_counts):
            # Jaws that rest are read often enough even if the deadline passed while this process was stopped.
            late += self._pace.now() > deadline
            if late > EQUAL_COUNTS:
                raise GripperFault(f"gripper count does not settle; last seen {_sketch(seen)}")
            if equal < EQUAL_COUNTS:
                self._pace.pause(move.settle_s)
            else:
                self._pace.idle(deadline)
            last, seen = seen, self._checked("settling")
            equal = (
                equal + 1 if seen.position_counts == last.position_counts and not seen.moving else 1
            )
        return seen


def over(
    link: Link,
    pace: Pace,
    report: Report,
    *,
    read_only: bool,
    profile: GripperProfile | None = None,
) -> Gripper:
    """A gripper on a link that was opened for it, and that is closed again if nobody answers there."""
    try:
        return Gripper(ReadOnlyLink(link) if read_only else link, pace, report, profile)
    except BaseException:  # Ctrl-C, too, must not leave the port open
        link.close()
        raise


def _agrees(seen: Reading, asked: int, start: int) -> bool:
    """Whether gOBJ fits the count of a move from `start` to `asked`: a stale or stuck one mostly does not."""
    if seen.object_flag == OBJ_AT_REQUEST:
        # Beyond the end stops there is no telling how far the jaws go: that depends on the fingers.
        short = min(asked, COUNT_CLOSED) - seen.position_counts
        beyond = seen.position_counts - max(asked, COUNT_OPEN)
        return short <= ARRIVED_COUNTS and (asked >= COUNT_CLOSED or beyond <= ARRIVED_COUNTS)
    closing = seen.object_flag == OBJ_CONTACT_CLOSING
    return asked == start or closing == (asked > start)


def _has_latched(seen: Reading) -> bool:
    """Whether it reports a fault that a reset alone clears."""
    return seen.fault != 0 and fault_text(seen.fault).severity == MAJOR


def _refuse_latched(seen: Reading, doing: str) -> None:
    if _has_latched(seen):
        raise fault(seen.fault, doing)


def _require_ready(seen: Reading, doing: str) -> None:
    if seen.fault and fault_text(seen.fault).severity in {MAJOR, PRIORITY}:
        raise fault(seen.fault, doing)
    if not seen.activated:
        raise GripperFault(
            f"gripper not active while {doing}; clear the jaws and activate it (--activate)"
        )


def _sketch(seen: Reading) -> str:
    return (
        f"gOBJ {seen.object_flag}, request {seen.echo_counts}, position {seen.position_counts}, "
        f"fault 0x{seen.fault:02X}"
    )
