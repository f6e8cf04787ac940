"""Device logic of a SCHUNK EGU or EGK: commands by edges of the control word, outcomes by the status word.

A closing motion is a grip, any other a positioning move: only a grip knows what it meets, to a move it is an
error. What is held is released before anything else, another grip included. Sources as of `registers`.
"""

from collections.abc import Callable
from typing import NamedTuple
from urllib.parse import parse_qsl

from drivers.clock import Pace
from drivers.errors import GripperFault, LinkTimeout, PortError
from drivers.links import no_report
from drivers.ports import GripperProfile, GripperState, ObjectState, Report, Settled
from drivers.schunk.link import SchunkLink
from drivers.schunk.registers import (
    BAUD,
    MOTIONS,
    NOT_FEASIBLE,
    OUTCOMES,
    PARITY,
    UNIT,
    Control,
    Input,
    Output,
    Status,
    error_text,
    is_soft,
)
from drivers.stream import SerialStream, Stream, open_tcp, tcp_address
from runtime.table import PROFILES

READY_S = 2.0  # from the acknowledgement to ready for operation; [BKS] MakeReady waits 0.5 s
RECEIVED_S = 1.0  # until the toggle says that a command was received; [BKS] 0.3 s
MOVE_MARGIN_S = 2.0  # beyond way / speed: acceleration, contact detection, settling
STEADY_READINGS, STEADY_S, STEADY_UM = (
    3,
    0.01,
    50,
)  # in a row, apart, and within, of fingers at rest
ARRIVED_UM, EMPTY_UM = 500, 1000  # farther from the target, or apart, contradicts the status
WRITE_TRIES = 3
LEAST_PERCENT, MOST_PERCENT = 50, 100  # of the force of a BasicGrip ([CM] 1.2.3)
STROKE_UM = 1000  # by which a stroke may differ from the profile's

GRIP_OUTCOMES = Status.GRIPPED | Status.NO_WORKPIECE


class Limits(NamedTuple):
    """What the module says of itself, in um, um/s and N."""

    lowest_um: int
    highest_um: int
    slowest_um_s: int
    fastest_um_s: int
    grip_um_s: int  # with the whole force
    force_n: float
    soft: bool  # whether it takes a velocity for gripping


class _Move(NamedTuple):
    output: Output
    toggle: Status  # RECEIVED_TOGGLE before it
    written_at: float
    budget_s: float


class Gripper:
    """A SCHUNK gripper. Connecting reads and never writes, nor acknowledges; every wait has a deadline.

    Every write whose answer was lost is reported.

    Raises:
        PortError: the module is no gripper of that profile.
    """

    def __init__(
        self,
        link: SchunkLink,
        pace: Pace,
        report: Report = no_report,
        profile: GripperProfile | None = None,
    ) -> None:
        self._link = link
        self._pace = pace
        self._report = report
        self._move: _Move | None = None
        soft = is_soft(int(link.read("module_type")[0]))
        self._profile = profile or PROFILES["schunk-egk" if soft else "schunk-egu"]
        self._limits = Limits(
            lowest_um=self._thousandths("min_pos"),
            highest_um=self._thousandths("max_pos"),
            slowest_um_s=self._thousandths("min_vel"),
            fastest_um_s=self._thousandths("max_vel"),
            grip_um_s=self._thousandths("max_grp_vel"),
            force_n=link.read("max_grp_force")[0],
            soft=soft,
        )
        stroke_um = self._thousandths("max_phys_stroke")
        if abs(stroke_um - self._profile.stroke_um) > STROKE_UM:
            raise PortError(
                f"the gripper at {link.endpoint} opens to {stroke_um / 1000:g} mm, a {self._profile.model} "
                f"to {self._profile.stroke_um / 1000:g} mm; correct the model, or the port"
            )

    @property
    def profile(self) -> GripperProfile:
        """What its model can do and tell."""
        return self._profile

    def state(self) -> GripperState:
        """Read the gripper now."""
        asked, seen = self._asked(), self._look()
        return GripperState(
            activated=bool(seen.status & Status.READY),
            moving=_moves(seen, asked),
            fault=seen.error,
            fault_text=_fault(seen.error) if seen.error else "",
            object=_object(seen, asked),
            target_um=self._target_um(asked),
            width_um=self._width_um(seen.position_um),
            current_ma=0,
        )

    def activate(self) -> None:
        """Acknowledge what keeps it from being ready, the start included; nothing moves."""
        seen = self._look()
        if seen.status & Status.READY and not seen.error:
            return
        at_rest = Output(Control.NO_FAST_STOP, self._width_um(seen.position_um))
        self._send(at_rest)  # only an edge acknowledges
        self._send(at_rest._replace(control=Control.NO_FAST_STOP | Control.ACKNOWLEDGE))
        self._until(
            lambda now: bool(now.status & Status.READY and not now.error),
            self._pace.deadline(READY_S),
            "being acknowledged",
        )

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Ask for a width; a part that is held is released first. `wait` tells how it ended."""
        self._move = None
        seen = self._checked("asked to move")
        if seen.status & Status.GRIPPED:
            seen = self._release(seen, width_um)
        output = self._request(width_um, speed_mm_s, force_n)
        way_um = abs(seen.position_um - output.position_um)
        rate_um_s = output.velocity_um_s or self._limits.grip_um_s * output.force_percent // 100
        self._command(output, seen, way_um / max(rate_um_s, 1))

    def wait(self) -> Settled:
        """Wait until the last move has ended and the fingers stand still."""
        if self._move is None:
            raise GripperFault("no move to wait for; call move() first")
        move = self._move
        seen = self._settled()
        asked = self._asked()
        if asked != move.output:
            raise GripperFault(
                "the gripper's request changed during the move; is another program using it?"
            )
        seconds = self._pace.elapsed(move.written_at)
        return Settled(
            self._width_um(seen.position_um),
            _object(seen, asked),
            0,
            self._target_um(asked),
            seconds,
        )

    def stop(self) -> None:
        """Stop the fingers where they are; what they hold stays held."""
        self._move = None
        asked, seen = self._asked(), self._look()
        if not seen.status & Status.READY:
            return
        # What is at rest is asked for once more what it was: no edge, no command, a grip goes on.
        stopped = asked._replace(control=Control.NO_FAST_STOP | Control.STOP)
        self._send(stopped if _moves(seen, asked) else asked)

    def close(self) -> None:
        """Close the link; nothing moves."""
        self._link.close()

    # -- the two double words ---------------------------------------------------------------------

    def _look(self) -> Input:
        status, *rest = map(int, self._link.read("plc_sync_input"))
        return Input(Status(status), *rest)

    def _asked(self) -> Output:
        control, *rest = map(int, self._link.read("plc_sync_output"))
        return Output(Control(control), *rest)

    def _thousandths(self, name: str) -> int:
        """A parameter in um or um/s."""
        return round(1000 * self._link.read(name)[0])

    def _width_um(self, position_um: int) -> int:
        return self._profile.reading_um(self._profile.step(position_um))

    def _target_um(self, asked: Output) -> int:
        position_um = 0 if asked.control & Control.GRIP else asked.position_um
        return self._width_um(min(max(position_um, 0), self._profile.stroke_um))

    def _request(self, width_um: int, speed_mm_s: float, force_n: float) -> Output:
        limits, speed_um_s = self._limits, int(1000 * speed_mm_s)
        if width_um > limits.lowest_um:
            speed_um_s = min(max(speed_um_s, limits.slowest_um_s), limits.fastest_um_s)
            position_um = min(width_um, limits.highest_um)
            return Output(_edge(Control.MOVE_ABSOLUTE), position_um, speed_um_s)
        percent = min(max(int(100 * force_n / limits.force_n), LEAST_PERCENT), MOST_PERCENT)
        fastest_um_s = limits.grip_um_s * percent // 100
        soft_um_s = min(max(speed_um_s, limits.slowest_um_s), fastest_um_s) if limits.soft else 0
        return Output(_edge(Control.GRIP), 0, soft_um_s, percent)

    # -- commands and their outcomes --------------------------------------------------------------

    def _release(self, seen: Input, width_um: int) -> Input:
        self._command(Output(_edge(Control.RELEASE), width_um), seen, 0.0)
        return self._settled()

    def _command(self, output: Output, seen: Input, seconds: float) -> None:
        # A command is an edge of its bit, or of this toggle where the bit is set already.
        toggled = ~self._asked().control & Control.REPEAT_TOGGLE
        output = output._replace(control=output.control | toggled)
        self._send(output)
        toggle = seen.status & Status.RECEIVED_TOGGLE
        self._move = _Move(output, toggle, self._pace.now(), seconds + MOVE_MARGIN_S)

    def _send(self, output: Output) -> None:
        """Write a request until it is acknowledged: the same once more is no edge, so no command."""
        for attempt in range(1, WRITE_TRIES + 1):
            try:
                self._link.write("plc_sync_output", *output)
            except LinkTimeout:
                arrived = self._asked() == output
                self._report("link", {"incident": "write unanswered", "arrived": arrived})
                if arrived:
                    return
                if attempt == WRITE_TRIES:
                    raise
            else:
                return

    def _settled(self) -> Input:
        """Wait until the command under way was received, says how it ended, and the fingers stand still."""
        assert self._move is not None
        move, self._move = self._move, None
        self._until(
            lambda now: now.status & Status.RECEIVED_TOGGLE != move.toggle,
            self._pace.deadline(RECEIVED_S),
            "taking the request",
        )
        deadline, late = self._pace.deadline(move.budget_s), 0
        readings: list[Input] = []
        while True:
            # Fingers that rest are read often enough even if this process was stopped past the deadline.
            late += self._pace.now() > deadline
            seen = self._look()
            _require_feasible(seen, "moving")
            ended = seen.status & _outcomes(move.output) and self._fits(seen, move.output)
            readings = [*readings, seen][-STEADY_READINGS:] if ended else []
            if len(readings) == STEADY_READINGS and _spread_um(readings) <= STEADY_UM:
                return seen
            if late > STEADY_READINGS:
                raise GripperFault(
                    f"gripper not done moving in time, or its status and width contradict one another; "
                    f"last seen {_sketch(seen)}"
                )
            if readings:
                self._pace.pause(STEADY_S)
            else:
                self._pace.idle(deadline)

    def _fits(self, seen: Input, output: Output) -> bool:
        """Whether the width is one that the status can tell of."""
        if output.control & Control.RELEASE or seen.status & Status.GRIPPED:
            return True
        if output.control & Control.GRIP:
            return seen.position_um - self._limits.lowest_um <= EMPTY_UM
        return abs(seen.position_um - output.position_um) <= ARRIVED_UM

    def _checked(self, doing: str) -> Input:
        seen = self._look()
        _require_ready(seen, doing)
        return seen

    def _until(self, done: Callable[[Input], bool], deadline: float, doing: str) -> None:
        """Poll until `done`, a refusal, or the deadline."""
        while True:
            late = self._pace.now() > deadline
            seen = self._look()
            if done(seen):
                return
            if late:
                cause = f": {_fault(seen.error)}" if seen.error else f"; last seen {_sketch(seen)}"
                raise GripperFault(f"gripper not done {doing} in time{cause}")
            self._pace.idle(deadline)


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> Gripper:
    """A SCHUNK gripper at `schunk:///dev/ttyUSB0?unit=12`, or at `schunk://host:port` behind a device server.

    Raises:
        PortError: the port cannot be opened or is not understood, or another gripper is there.
        LinkError: nobody answers.
    """
    address, _, settings = port.partition("?")
    unit = _unit_of(port, settings)
    path = address.removeprefix("schunk://")
    stream: Stream
    if path.startswith("/"):
        stream = SerialStream(path, BAUD, PARITY)
    else:
        stream = open_tcp(*tcp_address(address), port, "check address, cable and power")
    return over(stream, pace, report, profile, unit, read_only=read_only)


def over(
    stream: Stream,
    pace: Pace,
    report: Report,
    profile: GripperProfile | None,
    unit: int = UNIT,
    *,
    read_only: bool = False,
) -> Gripper:
    """A gripper on a line that was opened for it, and that is closed again if nobody answers there."""
    link = SchunkLink(stream, pace, report, unit, read_only=read_only)
    try:
        return Gripper(link, pace, report, profile)
    except BaseException:  # Ctrl-C, too, must not leave the port open
        link.close()
        raise


def _unit_of(port: str, settings: str) -> int:
    stated = parse_qsl(settings, keep_blank_values=True) or [("unit", str(UNIT))]
    unit = int(stated[0][1]) if stated[0][1].isdecimal() else 0
    if len(stated) > 1 or stated[0][0] != "unit" or not 1 <= unit <= 247:
        raise PortError(
            f"port {port} is not understood; write it as schunk:///dev/ttyUSB0?unit={UNIT}, unit 1 to 247"
        )
    return unit


def _edge(motion: Control) -> Control:
    return Control.NO_FAST_STOP | motion


def _moves(seen: Input, asked: Output) -> bool:
    """Whether the fingers are on their way: the device says only that they no longer are."""
    under_way = asked.control & MOTIONS and not seen.status & OUTCOMES
    return bool(seen.status & Status.READY and under_way)


def _object(seen: Input, asked: Output) -> ObjectState:
    if seen.status & Status.GRIPPED:
        inside = asked.control & Control.GRIP_FROM_INSIDE
        return ObjectState.OPENING if inside else ObjectState.CLOSING
    stands = seen.status & (Status.POSITION_REACHED | Status.NO_WORKPIECE)
    return ObjectState.AT_TARGET if stands and asked.control & MOTIONS else ObjectState.NONE


def _outcomes(output: Output) -> Status:
    """The bits that tell the end of what was asked for."""
    return GRIP_OUTCOMES if output.control & Control.GRIP else Status.POSITION_REACHED


def _require_feasible(seen: Input, doing: str) -> None:
    _require_ready(seen, doing)
    if seen.status & Status.NOT_FEASIBLE:
        reason = NOT_FEASIBLE.get(seen.additional, f"reason 0x{seen.additional:02X}")
        raise GripperFault(f"the gripper refused the command while {doing}: {reason}")


def _require_ready(seen: Input, doing: str) -> None:
    if seen.error:
        raise GripperFault(f"gripper not active while {doing}: {_fault(seen.error)}")
    if not seen.status & Status.READY:
        raise GripperFault(f"gripper not active while {doing}; acknowledge it (--activate)")


def _fault(code: int) -> str:
    text = error_text(code)
    return f"fault 0x{code:02X}, {text.sentence}; {text.remedy}"


def _spread_um(readings: list[Input]) -> int:
    widths = [reading.position_um for reading in readings]
    return max(widths) - min(widths)


def _sketch(seen: Input) -> str:
    return f"status 0x{seen.status:08X}, width {seen.position_um / 1000:.3f} mm"
