"""Example drivers of a gripper and an arm of a fictitious make, which exchange lines of text over TCP."""

import math

from drivers import ports
from drivers.clock import Pace
from drivers.errors import ArmError, GripperFault, LinkError, LinkTimeout, ReadOnlyError
from drivers.links import StreamLink
from drivers.ports import GripperProfile, GripperState, ObjectState, Report, Settled, no_report
from drivers.stream import Stream, closed_on_error, open_tcp, tcp_address

PROFILE = GripperProfile(
    model="other-60",
    stroke_um=60_000,
    resolution_um=10.0,
    noise_um=20,
    speed_mm_s=(10.0, 200.0),
    force_n=(5.0, 100.0),
)

QUESTIONS = ("status", "where")
MARGIN_S = 2.0  # time beyond a whole stroke at the requested speed
SPREAD_UM = 5 * PROFILE.noise_um  # largest distance between readings of fingers at rest


class Lines(StreamLink):
    """A link that sends a line of text and receives one; with `read_only` it sends nothing but questions."""

    def __init__(
        self, stream: Stream, pace: Pace, report: Report = no_report, *, read_only: bool
    ) -> None:
        super().__init__(stream, pace, report)
        self._read_only = read_only

    def ask(self, line: str, seconds: float = 0.0) -> list[str]:
        """Sends a line and returns the words of the answer; the device may take `seconds` to answer."""
        self._begin()
        if self._read_only and line not in QUESTIONS:
            raise ReadOnlyError(f"a dry run was about to send {line!r} to {self.endpoint}")
        text = b""
        try:
            self._stream.send(line.encode() + b"\n")
            for piece in self._pieces(seconds):
                text += piece
                if text.endswith(b"\n"):
                    return text.decode("ascii", "replace").split()
        except OSError as error:
            raise self._broken(error, "the cable") from error
        self._lost = "an answer is missing"
        raise LinkTimeout(f"{self.endpoint} did not answer {line!r}; check its power")


class OtherGripper:
    """The driver of the gripper, whose protocol states openings in mm."""

    profile = PROFILE

    def __init__(self, lines: Lines, pace: Pace) -> None:
        self._lines, self._pace = lines, pace
        self._asked: tuple[int, float, float] | None = None
        self.state()

    def state(self) -> GripperState:
        words = self._lines.ask("status")
        try:
            ready, moving, held, asked_mm, at_mm = words
            target_um, width_um = (round(1000 * float(mm)) for mm in (asked_mm, at_mm))
        except (ValueError, OverflowError) as error:
            said = " ".join(words)
            raise LinkError(f"{self._lines.endpoint} answered {said!r}; check its make") from error
        at_rest = ObjectState.CLOSING if held == "1" else ObjectState.AT_TARGET
        seen = ObjectState.NONE if moving == "1" else at_rest
        return GripperState(ready == "1", moving == "1", 0, "", seen, target_um, width_um, 0)

    def activate(self) -> None:
        if self.state().activated:
            return
        self._lines.ask("home")
        deadline = self._pace.deadline(5.0)
        while not self.state().activated:
            self._wait(deadline, "homing")

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        self._asked = None
        if not self.state().activated:
            raise GripperFault("gripper not active; home it first")
        asked_um = max(width_um, 0)
        self._lines.ask(f"go {asked_um / 1000:.3f} {speed_mm_s:.1f} {force_n:.1f}")
        self._asked = asked_um, self._pace.now(), PROFILE.stroke_um / 1000 / speed_mm_s

    def wait(self) -> Settled:
        if self._asked is None:
            raise GripperFault("no move to wait for; call move() first")
        (asked, since, stroke_s), self._asked = self._asked, None
        deadline = self._pace.deadline(stroke_s + MARGIN_S)
        seen, alike = self.state(), 1  # the device answers a move once it has begun
        while seen.moving or alike < 3:
            self._wait(deadline, "moving")
            before, seen = seen, self.state()
            alike = alike + 1 if abs(seen.width_um - before.width_um) <= SPREAD_UM else 1
        if seen.target_um != asked or not seen.activated:
            raise GripperFault("the gripper forgot the move; was its power cut?")
        return Settled(seen.width_um, seen.object, 0, asked, self._pace.elapsed(since))

    def stop(self) -> None:
        self._lines.ask("stop")

    def close(self) -> None:
        self._lines.close()

    def _wait(self, deadline: float, doing: str) -> None:
        if self._pace.now() > deadline:
            raise GripperFault(f"gripper not done {doing} in time")
        self._pace.idle(deadline)


def gripper(
    port: str, pace: Pace, report: Report, *, read_only: bool, profile: GripperProfile | None
) -> OtherGripper:
    stream = open_tcp(*tcp_address(port), port, "check its power")
    lines = Lines(stream, pace, report, read_only=read_only)
    with closed_on_error(lines):  # on Ctrl-C, too
        return OtherGripper(lines, pace)


class OtherArm:
    """The driver of the arm, which refuses unreachable targets.

    After a missing answer the state of the arm is unknown.
    """

    def __init__(self, lines: Lines) -> None:
        self._lines = lines

    def pose(self) -> ports.PoseOfHand:
        words = self._ask("where")
        try:
            x, y, z, angle = map(float, words)
        except ValueError as error:
            raise ArmError(f"arm answered {' '.join(words)!r}; check its make") from error
        return x, y, z, angle

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        return -math.inf, math.inf

    def obstacle(self, start: ports.PoseOfHand, target: ports.PoseOfHand) -> str:
        return ""

    def move_linear(
        self, target: ports.PoseOfHand, speed_mm_s: float, radius_mm: float = ports.TURN_RADIUS_MM
    ) -> None:
        finite = all(map(math.isfinite, (*target, speed_mm_s)))
        if not (finite and speed_mm_s > 0.0 and max(target) <= 1e3):
            raise ArmError(f"arm not moved: {target} at {speed_mm_s} mm/s cannot be sent")
        path_s = math.dist(target[:3], self.pose()[:3]) / speed_mm_s
        line = f"move {' '.join(map(str, target))} {speed_mm_s}"
        if self._ask(line, 2.0 * path_s + 1.0) != ["ok"]:
            raise ArmError(f"arm not moved: {target} is out of its reach")

    def close(self) -> None:
        self._lines.close()

    def _ask(self, line: str, seconds: float = 0.0) -> list[str]:
        try:
            return self._lines.ask(line, seconds)
        except LinkError as error:
            raise ArmError(f"arm lost, state unknown since {error}") from error


def arm(url: str, pace: Pace, *, read_only: bool) -> OtherArm:
    stream = open_tcp(*tcp_address(url), url, "check its power")
    return OtherArm(Lines(stream, pace, read_only=read_only))
