"""Device logic of a SCHUNK EGU or EGK: commands in a control word, outcomes in a status word.

A control bit that changes to 1 is a command. A request to close is sent as a grip, any other request as a
positioning move; a positioning move that meets a part ends in an error. A held part is released before the
next motion, even before a grip. `drivers.schunk.registers` lists the sources.
"""

from functools import partial
from typing import NamedTuple

from drivers.clock import Pace
from drivers.errors import GripperFault, PortError
from drivers.modbus import address
from drivers.polling import MOVE_MARGIN_S, Move, PolledGripper
from drivers.ports import GripperProfile, GripperState, ObjectState, Report
from drivers.schunk import registers as schunk
from drivers.schunk.link import SchunkLink
from drivers.schunk.registers import Control, Input, Output, Status, error_text, is_soft
from runtime.table import PROFILES

READY_S = 2.0  # time from the acknowledgement to ready for operation; [BKS] MakeReady waits 0.5 s
STEADY_S = 0.01  # time between readings of fingers at rest
# Distance from the target, and from the limit of an empty grip, that contradicts the status.
ARRIVED_UM, EMPTY_UM = 500, 1000
LEAST_PERCENT, MOST_PERCENT = 50, 100  # per cent of the force of a BasicGrip ([CM] 1.2.3)
STROKE_UM = 1000  # tolerated difference between stroke and profile

GRIP_OUTCOMES = Status.GRIPPED | Status.NO_WORKPIECE


class Limits(NamedTuple):
    """Limits reported by the gripper, in um, um/s and N."""

    lowest_um: int
    highest_um: int
    slowest_um_s: int
    fastest_um_s: int
    grip_um_s: int  # velocity of a grip with the whole force
    force_n: float
    soft: bool  # whether the gripper accepts a velocity for gripping


class Gripper(PolledGripper[Input, Output]):
    """Driver of a SCHUNK gripper; the target of a move is an `Output`.

    Connecting only reads; only `activate` acknowledges errors of the gripper.

    Raises:
        PortError: the stroke of the gripper differs from the profile's stroke.
    """

    spread = 50  # um

    _link: SchunkLink

    def _begin(self, profile: GripperProfile | None) -> GripperProfile:
        soft = is_soft(int(self._link.read("module_type")[0]))
        profile = profile or PROFILES["schunk-egk" if soft else "schunk-egu"]
        names = ("min_pos", "max_pos", "min_vel", "max_vel", "max_grp_vel")
        lowest, highest, slowest, fastest, grip = map(self._thousandths, names)
        force_n = self._link.read("max_grp_force")[0]
        self._limits = Limits(lowest, highest, slowest, fastest, grip, force_n, soft)
        stroke_um = self._thousandths("max_phys_stroke")
        if abs(stroke_um - profile.stroke_um) > STROKE_UM:
            raise PortError(
                f"the gripper at {self._link.endpoint} opens to {stroke_um / 1000:g} mm, a {profile.model} "
                f"to {profile.stroke_um / 1000:g} mm; correct the model, or the port"
            )
        return profile

    def state(self) -> GripperState:
        """Reads the state of the gripper.

        The status is read last, so that repeated reads of other values do not make it stale.
        """
        asked = self._asked()
        return self._state(self._read(), asked)

    def activate(self) -> None:
        """Acknowledges errors, so that the gripper becomes ready; nothing moves."""
        seen = self._read()
        if seen.ready:
            return
        at_rest = Output(Control.NO_FAST_STOP, self._width_um(seen.position_um))
        self._send(at_rest)  # only an edge acknowledges
        self._send(at_rest._replace(control=Control.NO_FAST_STOP | Control.ACKNOWLEDGE))
        self._until(lambda now: now.ready, self._pace.deadline(READY_S), "being acknowledged")

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        """Requests a width; releases a held part first. `wait` returns the result."""
        self._move = None
        asked, seen = self._asked(), self._checked("asked to move")
        if seen.status & Status.GRIPPED:
            release = Output(_edge(Control.RELEASE), width_um)
            asked = self._command(release, asked, seen, MOVE_MARGIN_S)
            seen = self._settled()
        output = self._request(width_um, speed_mm_s, force_n)
        rate_um_s = output.velocity_um_s or self._limits.grip_um_s * output.force_percent // 100
        self._command(output, asked, seen, self._budget_s(max(rate_um_s, 1) / 1000.0))

    def stop(self) -> None:
        """Stops the fingers where they are; a held part stays held."""
        self._move = None
        asked, seen = self._asked(), self._read()
        if not seen.status & Status.READY:
            return
        # A gripper at rest gets its request again: no edge, no command, a grip continues.
        stopped = asked._replace(control=Control.NO_FAST_STOP | Control.STOP)
        self._send(stopped if _moves(seen, asked) else asked)

    # -- the two double words ---------------------------------------------------------------------

    def _read(self) -> Input:
        return Input.of(self._link.read("plc_sync_input"))

    def _asked(self) -> Output:
        return Output.of(self._link.read("plc_sync_output"))

    def _thousandths(self, name: str) -> int:
        """Reads a parameter in mm or mm/s; returns it in um or um/s."""
        return round(1000 * self._link.read(name)[0])

    def _width_um(self, position_um: int) -> int:
        return self.profile.reading_um(self.profile.step(position_um))

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

    def _command(self, output: Output, asked: Output, seen: Input, budget_s: float) -> Output:
        """Sends a command with its toggle bit changed, since the device acts on changes.

        `wait` then waits for the move.

        Args:
            output: the command.
            asked: the last output before the command.
            seen: the last reading before the command.
            budget_s: time limit of the motion, device seconds.

        Returns:
            The output with the changed toggle bit.
        """
        # The device executes a command when its bit is set or, with the bit set already, when this toggle
        # changes.
        toggled = ~asked.control & Control.REPEAT_TOGGLE
        output = output._replace(control=output.control | toggled)
        self._send(output)
        self._move = Move(output, seen, self._pace.now(), budget_s, STEADY_S)
        return output

    def _send(self, output: Output) -> None:
        """Writes an output until a write is acknowledged; a repeated output is no new command."""
        write = partial(self._link.write, "plc_sync_output", *output)
        self._repeat(write, lambda: self._asked() == output)

    # -- what readings mean -----------------------------------------------------------------------

    def _target(self, seen: Input) -> Output:
        del seen
        return self._asked()

    def _state(self, seen: Input, target: Output) -> GripperState:
        asked_um = 0 if target.control & Control.GRIP else target.position_um
        return GripperState(
            activated=bool(seen.status & Status.READY),
            moving=_moves(seen, target),
            fault=seen.error,
            fault_text=error_text(seen.error) if seen.error else "",
            object=_object(seen, target),
            target_um=self._width_um(min(max(asked_um, 0), self.profile.stroke_um)),
            width_um=self._width_um(seen.position_um),
            current_ma=0,
        )

    def _received(self, seen: Input, move: Move[Input, Output]) -> bool:
        return bool((seen.status ^ move.before.status) & Status.RECEIVED_TOGGLE)

    def _rest(self, seen: Input, move: Move[Input, Output]) -> int | None:
        return seen.position_um if self._fits(seen, move) else None

    def _fits(self, seen: Input, move: Move[Input, Output]) -> bool:
        """Whether the status reports the end of the move and agrees with the width."""
        control, position_um = move.target.control, seen.position_um
        outcomes = GRIP_OUTCOMES if control & Control.GRIP else Status.POSITION_REACHED
        if not seen.status & outcomes:
            return False
        if control & Control.RELEASE or seen.status & Status.GRIPPED:
            return True
        if control & Control.GRIP:
            return position_um - self._limits.lowest_um <= EMPTY_UM
        return abs(position_um - move.target.position_um) <= ARRIVED_UM

    def _require_ready(self, seen: Input, doing: str) -> None:
        if seen.error:
            raise GripperFault(f"gripper not active while {doing}: fault {error_text(seen.error)}")
        if not seen.status & Status.READY:
            raise GripperFault(f"gripper not active while {doing}; acknowledge it (--activate)")

    def _require_obeyed(self, seen: Input, doing: str) -> None:
        self._require_ready(seen, doing)
        if seen.status & Status.NOT_FEASIBLE:
            reason = schunk.NOT_FEASIBLE.get(seen.additional, f"reason 0x{seen.additional:02X}")
            raise GripperFault(f"the gripper refused the command while {doing}: {reason}")

    def _sketch(self, seen: Input) -> str:
        words = f"status 0x{seen.status:08X}, width {seen.position_um / 1000:.3f} mm"
        return f"{words}, fault {error_text(seen.error)}" if seen.error else words


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> Gripper:
    """Opens a SCHUNK gripper at `schunk:///dev/ttyUSB0`, or at `schunk://host:port` behind a device server.

    `?unit=12` at the end of the port's name states the slave id.

    Raises:
        PortError: the port is invalid or cannot be opened, or another gripper is there.
        LinkError: there is no answer.
    """
    unit = address.unit_of(port, schunk.UNIT)
    link = SchunkLink(address.opened(port, schunk.BAUD, schunk.PARITY), pace, report, unit)
    return Gripper(link, pace, report, profile, read_only=read_only)


def _edge(motion: Control) -> Control:
    return Control.NO_FAST_STOP | motion


def _moves(seen: Input, asked: Output) -> bool:
    """Whether a motion is under way: the last output requests one, and its end is not reported yet."""
    under_way = asked.control & Control.MOTIONS and not seen.status & Status.OUTCOMES
    return bool(seen.status & Status.READY and under_way)


def _object(seen: Input, asked: Output) -> ObjectState:
    if seen.status & Status.GRIPPED:
        inside = asked.control & Control.GRIP_FROM_INSIDE
        return ObjectState.OPENING if inside else ObjectState.CLOSING
    stands = seen.status & (Status.POSITION_REACHED | Status.NO_WORKPIECE)
    return ObjectState.AT_TARGET if stands and asked.control & Control.MOTIONS else ObjectState.NONE
