"""Device logic of a Robotiq 2F gripper: activation, moves, and telling a finished move from a stale flag.

Written against any link that reads and writes the two register blocks. Follows the 2F-85 manual ([M18]
p54-62) and the order of Robotiq's own SDK (`gripper.cpp`, `gripper_state.cpp`).
"""

from collections.abc import Callable
from typing import NamedTuple

from drivers.clock import Pace
from drivers.errors import MAJOR, GripperFault, LinkTimeout, fault_text
from drivers.robotiq.link import Link, LinkCounters, ReadOnlyLink, Report, no_report
from drivers.robotiq.registers import COUNT_CLOSED, COUNT_OPEN, OPENING_MM, OUTPUT_FIELDS, pack, speed_mm_s
from drivers.robotiq.state import (
    GripperState,
    accept_any,
    agrees,
    decode,
    refuse_major,
    require_ready,
    sketch,
)

ACTIVATION_S = 15.0  # reset, sweep and report, all told ([SDK] gripper.cpp; 5 s was too short for some)
ECHO_S = 1.0  # gPR must echo rPR within this ([SDK] gripper.cpp)
STALE_FLAG_S = 0.2  # how long gOBJ may still tell of the previous move ([SDK] gripper.cpp)
MOVE_MARGIN_S = 2.0  # beyond stroke / speed: start, contact detection, settling
EQUAL_COUNTS = 3  # readings in a row with one count before a width is believed
SETTLE_S = 0.02  # between them: at 20 mm/s the count changes once in as long
COMM_SILENCE = 0x09
WRITE_TRIES = 3  # as the SDK: the link is down after 3 failures in a row


class Settled(NamedTuple):
    """How a move ended: where the jaws rest and why, `seconds` (of the device) after it was asked for."""

    position_counts: int
    object_flag: int
    current_ma: int
    echo_counts: int
    seconds: float


class _Move(NamedTuple):
    """A move on its way: what was asked, from where, when, and the device seconds it may take."""

    position_counts: int
    start_counts: int
    written_at: float
    budget_s: float


class Gripper:
    """A Robotiq 2F gripper. Connecting reads and never writes; every wait has a deadline.

    Args:
        link: the register blocks.
        pace: deadlines in the gripper's own seconds.
        report: told of every write whose answer was lost, as ("link", {"incident": ..., ...}).

    Raises:
        LinkError: it cannot be read.
    """

    def __init__(self, link: Link, pace: Pace, report: Report = no_report) -> None:
        self._link = link
        self._pace = pace
        self._report = report
        self._move: _Move | None = None
        # Seeded from what the gripper does now, so that the first write cannot move a holding gripper.
        seen = self.state()
        self._image = {"rACT": int(seen.enabled), "rGTO": int(seen.going), "rPR": seen.echo_counts}

    @property
    def endpoint(self) -> str:
        """The port as it was named."""
        return self._link.endpoint

    @property
    def counters(self) -> LinkCounters:
        """What the link has been through so far."""
        return self._link.counters

    def state(self) -> GripperState:
        """Read the gripper now.

        Raises:
            LinkError: it cannot be read.
        """
        seen = decode(self._link.read())
        if seen.fault == COMM_SILENCE:
            # Fault 9 tells of the silence before this very request; the next reading tells of now.
            seen = decode(self._link.read())
        return seen

    def activate(self, *, after_fault: bool = False) -> None:
        """Reset and activate: the jaws sweep fully open and closed, whatever they hold is dropped.

        A gripper that is active already is left alone: nothing is written.

        Args:
            after_fault: also recover from a latched fault; without it one is reported, never cleared
            silently.

        Raises:
            GripperFault: a major fault is latched, something blocked the sweep, or 15 s were not enough.
            LinkError: the gripper cannot be reached.
        """
        seen = self.state()
        latched = fault_text(seen.fault).severity == MAJOR if seen.fault else False
        if latched and not after_fault:
            raise GripperFault.from_code(seen.fault, "asked to activate")
        if seen.activated and not latched:
            return
        deadline = self._pace.deadline(ACTIVATION_S)
        if latched or not seen.activating:
            self._send({})
            self._until(lambda now: not now.enabled, deadline, "resetting", accept_any)
            self._send({"rACT": 1})
        self._until(lambda now: now.activated, deadline, "activating", refuse_major)

    def move(self, position_counts: int, speed_counts: int, force_counts: int) -> None:
        """Ask for a position; `wait` tells how it ended.

        Args:
            position_counts: rPR, 0 open to 255 closed.
            speed_counts: rSP, 0 slowest (20 mm/s) to 255 (150 mm/s).
            force_counts: rFR, 0 weakest to 255.

        Raises:
            GripperFault: it is not active, or has a fault.
            LinkError: it cannot be reached.
        """
        self._move = None
        seen = self.state()
        require_ready(seen, "asked to move")
        request = {"rACT": 1, "rGTO": 1, "rPR": position_counts, "rSP": speed_counts, "rFR": force_counts}
        stroke_mm = abs(position_counts - seen.position_counts) * OPENING_MM / (COUNT_CLOSED - COUNT_OPEN)
        budget_s = stroke_mm / speed_mm_s(speed_counts) + MOVE_MARGIN_S
        self._send(request)
        self._move = _Move(position_counts, seen.position_counts, self._pace.now(), budget_s)

    def wait(self) -> Settled:
        """Wait until the last move has ended and the count stands still.

        In the SDK's order: gPR echoes the request; gOBJ had its chance to drop to 0 (it can lag the echo,
        and a short move may never show it); gOBJ is no longer 0; three readings in a row give one count that
        gOBJ does not contradict.

        Raises:
            GripperFault: no move was asked for, the request is not echoed, or the move does not end in time.
            LinkError: the gripper cannot be reached.
        """
        if self._move is None:
            raise GripperFault("no move to wait for; call move() first")
        move, self._move = self._move, None
        deadline = self._pace.deadline(ECHO_S)
        self._until(
            lambda now: now.echo_counts == move.position_counts,
            deadline,
            "taking the request",
            require_ready,
        )
        stale_until = move.written_at + STALE_FLAG_S / self._pace.time_scale
        deadline = self._pace.deadline(move.budget_s)
        seen = self._checked("moving")
        while not seen.moving and self._pace.now() < stale_until:
            self._pace.idle(stale_until)
            seen = self._checked("moving")
        seen = self._until(lambda now: now.going and not now.moving, deadline, "moving", require_ready)
        seen = self._steady(seen, move, deadline)
        if seen.echo_counts != move.position_counts:
            raise GripperFault("the gripper's request changed during the move; is another program using it?")
        return Settled(
            seen.position_counts,
            seen.object_flag,
            seen.current_ma,
            seen.echo_counts,
            self._pace.elapsed(move.written_at),
        )

    def stop(self) -> None:
        """Stop the jaws where they are; the request stays, a held part stays held. An activation is reset."""
        self._move = None
        seen = self.state()
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

        Speed and force are not echoed, so no reading tells that they arrived; only the answer to the write
        does. The same block once more changes nothing: there is no edge in it.

        Raises:
            GripperFault: the gripper is no longer active, so that the block would not be the same to it.
            LinkTimeout: no write was acknowledged.
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
        seen = self.state()
        sweeps = not seen.enabled and self._image.get("rACT") == image.get("rACT") == 1
        if image.get("rGTO") == 1 or sweeps:  # rACT set in a gripper that lost power starts the sweep
            require_ready(seen, "repeating a write whose answer was lost")
        wanted = (image.get("rACT", 0) == 1, image.get("rGTO", 0) == 1, image.get("rPR", 0))
        return (seen.enabled, seen.going, seen.echo_counts) == wanted

    def _checked(self, doing: str) -> GripperState:
        seen = self.state()
        require_ready(seen, doing)
        return seen

    def _until(
        self,
        done: Callable[[GripperState], bool],
        deadline: float,
        doing: str,
        check: Callable[[GripperState, str], None],
    ) -> GripperState:
        """Poll until `done`, a state that `check` refuses, or the deadline."""
        while True:
            late = self._pace.now() > deadline
            seen = self.state()
            if done(seen):
                return seen
            check(seen, doing)
            if late:
                raise GripperFault(f"gripper not done {doing} in time; last seen {sketch(seen)}", seen.fault)
            self._pace.idle(deadline)

    def _steady(self, seen: GripperState, move: _Move, deadline: float) -> GripperState:
        """Read until the count has been the same three times in a row, and agrees with gOBJ."""
        equal, late = 1, 0
        while equal < EQUAL_COUNTS or not agrees(seen, move.position_counts, move.start_counts):
            # Jaws that rest are read often enough even if the deadline passed while this process was stopped.
            late += self._pace.now() > deadline
            if late > EQUAL_COUNTS:
                raise GripperFault(f"gripper count does not settle; last seen {sketch(seen)}", seen.fault)
            if equal < EQUAL_COUNTS:
                self._pace.pause(SETTLE_S)
            else:
                self._pace.idle(deadline)
            last, seen = seen, self._checked("settling")
            equal = equal + 1 if seen.position_counts == last.position_counts and not seen.moving else 1
        return seen


def over(link: Link, pace: Pace, report: Report, *, read_only: bool) -> Gripper:
    """A gripper on a link that was opened for it, and that is closed again if nobody answers there.

    Args:
        link: the register blocks; owned from now on.
        pace: deadlines.
        report: told of every retry and failure.
        read_only: put a link that cannot write in between.

    Raises:
        LinkError: it cannot be read.
    """
    try:
        return Gripper(ReadOnlyLink(link) if read_only else link, pace, report)
    except BaseException:  # Ctrl-C, too, must not leave the port open
        link.close()
        raise
