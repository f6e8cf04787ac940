"""An ABB arm behind an open_abb server: straight moves with deadlines, none after a silence.

The server has no stop command and answers nothing while it moves; a motion fault shows as silence. So a
silence makes the arm's state unknown, and this object refuses everything from then on.
"""

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from drivers.abb import codec
from drivers.abb.codec import Pose, ProtocolError, Reply
from drivers.abb.reach import Setup, Wrist, obstacle
from drivers.clock import Pace
from drivers.errors import ArmError, ReadOnlyError
from drivers.ports import TURN_RADIUS_MM, PoseOfHand
from drivers.stream import Stream, open_tcp

ACCEPT_S = 0.5  # the server sleeps this long after accepting (SERVER.mod ServerCreateAndConnect)
STALE_S = 0.2  # and a stale acknowledgement follows at once
ANSWER_S = 2.0  # commands that do not move
MOVE_MARGIN_S = 3.0  # acceleration, fine point, network
QUIET_S = 0.01  # wall: a reply without terminator is whole when nothing follows it for so long
LATE_LOOKS = 3  # past a deadline, at what is there already: this process may have been stopped meanwhile
MOST_TURN_RAD = 3.0  # in one motion: the controller turns the shortest way, at half a turn it may be either
CONNECT_TRIES = 3


class _CutOffError(ArmError):
    """The server hung up; on a fresh connection that is no news."""


class ArmPose(NamedTuple):
    """Where the hand is, work object frame: mm, and its turn about the vertical, whole turns counted."""

    x_mm: float
    y_mm: float
    z_mm: float
    angle_rad: float

    @property
    def frame(self) -> Pose:
        """The pose of a hand that points down there."""
        return Pose(self.x_mm, self.y_mm, self.z_mm, codec.hand_rotation(self.angle_rad))


class Arm:
    """An arm on an open connection, which it owns; `connect` opens one.

    The setup's frames are sent on every connection, its limits checked before every move.

    Raises:
        ArmError: it does not answer as an open_abb server.
    """

    def __init__(self, stream: Stream, pace: Pace, setup: Setup) -> None:
        self.endpoint = stream.endpoint
        self._stream = stream
        self._pace = pace
        self._setup = setup
        self._unknown = ""  # why the state is unknown
        self._owed: tuple[int, float] | None = None  # code and deadline of a reply still to come
        self._text = ""
        self._late_s = 0.0  # by how much the last reply was read too late
        self._speed = math.nan
        self._at: ArmPose | None = None  # None: not known since the last motion
        self._angle_rad: float | None = None  # the last angle known, the next is counted on from it
        self._wrist: Wrist | None = None
        self._wrist_is_fresh = False
        self._drain()
        self._ask(codec.PING)
        if setup.read_only:
            return
        # All settings outlive a client: the server still has those of whoever was here before.
        self._ask(codec.SET_TOOL, codec.pose_numbers(setup.tool))
        self._ask(codec.SET_WORK_OBJECT, codec.pose_numbers(setup.work_object))
        self._set_speed(100.0)
        self._ask(codec.SET_ZONE, ("1", "0", "0", "0"))  # fine: acknowledged when it stands

    def pose(self) -> ArmPose:
        """Read where the hand is (0.01 mm, about 1 mrad)."""
        reply = self._ask(codec.READ_POSE)
        if self._late_s > 0.0:  # it tells of a moment that is too long ago
            reply = self._ask(codec.READ_POSE)
        if self._late_s > 0.0:
            raise ArmError(
                f"arm at {self.endpoint} answered, but this process was stopped or starved and read it "
                f"{self._late_s:.1f} s too late; take load off this machine"
            )
        with self._understood():
            x_mm, y_mm, z_mm, *rotation = codec.parse_numbers(reply)
            angle_rad = codec.hand_angle(rotation)
        if self._angle_rad is None:
            # Counted so that axis 6 near its middle gives angles near zero; the joints tell the whole turns.
            whole_rad = angle_rad + math.radians(self._joints()[5])
            turns = math.tau * math.floor((1.5 * math.pi - whole_rad) / math.tau)
            self._wrist = Wrist(whole_rad + turns, x_mm, y_mm)
            self._angle_rad, self._wrist_is_fresh = angle_rad + turns, True
        else:
            self._angle_rad += math.remainder(angle_rad - self._angle_rad, math.tau)
        self._at = ArmPose(x_mm, y_mm, z_mm, self._angle_rad)
        return self._at

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        """Least and greatest angle that the hand can be turned to at a place, whole turns counted, rad.

        Reads the joints if the arm has moved since they were read.
        """
        here, counted = self._at or self.pose(), self._wrist
        assert counted is not None  # since the first pose
        if not self._wrist_is_fresh:
            seen = Wrist(here.angle_rad + math.radians(self._joints()[5]), here.x_mm, here.y_mm)
            if abs(counted.moved(here.x_mm, here.y_mm, self._setup) - seen.whole_rad) > math.pi:
                raise ArmError(
                    f"arm at {self.endpoint}: the wrist stands whole turns off what was counted; find out "
                    "who else moves the arm, then connect again"
                )
            self._wrist, self._wrist_is_fresh, counted = seen, True, seen
        return counted.turn_range(x_mm, y_mm, self._setup)

    def obstacle(self, start: PoseOfHand, target: PoseOfHand) -> str:
        """Why a straight way cannot be gone; empty where nothing is known against it."""
        return obstacle(ArmPose(*start).frame, ArmPose(*target).frame, self._setup)

    def move_linear(self, x_mm: float, y_mm: float, z_mm: float, angle_rad: float, speed_mm_s: float) -> None:
        """Move the hand, pointing down, in a straight line and return when it stands (`ports.Arm`).

        Nothing is sent where the target cannot be sent or reached; of an arm that does not arrive in time the
        state is unknown, and every further call is refused.
        """
        target = ArmPose(x_mm, y_mm, z_mm, angle_rad)
        try:
            numbers = codec.pose_numbers(target.frame)
        except (ProtocolError, ValueError) as error:
            raise ArmError(f"arm not moved: {error}") from error
        start = self._at or self.pose()
        if reason := self.obstacle(start, target) or self._overturn(start, target):
            told = f"({x_mm:.1f}, {y_mm:.1f}, {z_mm:.1f}) mm"
            raise ArmError(f"arm not moved: the way to {told} is {reason}")
        self._set_speed(speed_mm_s)
        self._at, self._wrist_is_fresh = None, False
        path_mm, turn_rad = math.dist(start[:3], target[:3]), abs(target.angle_rad - start.angle_rad)
        travel_s = max(path_mm, TURN_RADIUS_MM * turn_rad) / speed_mm_s
        self._ask(codec.MOVE_LINEAR, numbers, travel_s * 1.5 + MOVE_MARGIN_S)
        self._at, self._angle_rad = target, target.angle_rad

    def _overturn(self, start: ArmPose, target: ArmPose) -> str:
        """Why a hand cannot be turned so far; one that stands beyond the range already may be turned back."""
        if abs(target.angle_rad - start.angle_rad) > MOST_TURN_RAD:
            return "half a turn or more, which the controller may go either way; go it in several motions"
        assert self._wrist is not None  # since the first pose
        low, high = self._wrist.turn_range(target.x_mm, target.y_mm, self._setup)
        if min(low, start.angle_rad) <= target.angle_rad <= max(high, start.angle_rad):
            return ""
        least, most = self._setup.wrist
        return f"farther round than the wrist turns ({least:g} to {most:g} deg)"

    def _joints(self) -> tuple[float, ...]:
        reply = self._ask(codec.READ_JOINTS)
        with self._understood():
            return codec.parse_numbers(reply)

    @contextlib.contextmanager
    def _understood(self) -> Iterator[None]:
        try:
            yield
        except ProtocolError as error:
            raise ArmError(f"arm at {self.endpoint}: {error}") from error

    def close(self) -> None:
        """Hang up; the arm does not move. A silent one is left without a word."""
        if not self._unknown:
            with contextlib.suppress(OSError):
                self._stream.send(codec.command(codec.CLOSE))
        self._unknown = self._unknown or "it was closed"
        self._stream.close()

    def _set_speed(self, speed_mm_s: float) -> None:
        if speed_mm_s == self._speed:
            return
        if not speed_mm_s > 0.0:
            raise ArmError(f"arm speed {speed_mm_s} mm/s; give a positive one")
        turn_deg_s = math.degrees(speed_mm_s / TURN_RADIUS_MM)
        try:
            numbers = (codec.number(speed_mm_s, 3), codec.number(turn_deg_s, 3))
        except ProtocolError as error:
            raise ArmError(f"arm speed: {error}") from error
        self._speed = math.nan  # until it is acknowledged
        self._ask(codec.SET_SPEED, numbers)
        self._speed = speed_mm_s

    def _drain(self) -> None:
        """Wait out the server's start and throw away what it still had to tell its last client."""
        until = self._pace.now() + (ACCEPT_S + STALE_S) / self._pace.time_scale
        while (left := until - self._pace.now()) > 0.0:
            try:
                self._stream.receive(left)
            except OSError as error:
                raise self._lose("the connection broke", _CutOffError) from error

    def _ask(self, code: int, numbers: tuple[str, ...] = (), budget_s: float = ANSWER_S) -> Reply:
        if self._unknown:
            raise ArmError(
                f"arm at {self.endpoint}: state unknown since {self._unknown}; "
                "look at the arm, then connect again"
            )
        line = codec.command(code, *numbers)
        told = repr(line.decode())
        if self._setup.read_only and code not in codec.HARMLESS:
            raise ReadOnlyError(f"a dry run was about to send {told} to the arm at {self.endpoint}")
        try:
            # After an interrupt the server may still be busy with the last command: it cannot listen before.
            reply = None
            if self._owed is None or self._await_reply(*self._owed) is not None:
                self._owed = (code, self._pace.deadline(budget_s))
                self._stream.send(line)
                reply = self._await_reply(*self._owed)
        except OSError as error:
            raise self._lose("the connection broke", _CutOffError) from error
        except ProtocolError as error:
            raise self._lose(f"an answer that does not fit: {error}") from error
        if reply is None:
            raise self._lose(f"{budget_s:.1f} s of silence after {told}")
        self._owed = None
        if not reply.done:
            raise ArmError(f"arm at {self.endpoint} refused {told} as a bad message")
        return reply

    def _await_reply(self, code: int, deadline: float) -> Reply | None:
        late = 0
        while late < LATE_LOOKS:
            left = deadline - self._pace.now()
            late += left <= 0.0
            reply = codec.parse_reply(self._text, code) if self._text else None
            if reply is not None and not (reply.fields and self._more(QUIET_S, code)):
                self._text = ""
                self._late_s = max(-left, 0.0)
                return reply
            if reply is None:
                self._more(max(left, 0.0), code)
        return None

    def _more(self, seconds: float, code: int) -> bool:
        """Whether more of the reply to `code` came within so many seconds."""
        piece = self._stream.receive(seconds).decode("latin-1")
        self._text = codec.drop_stale(self._text + piece, code)
        return bool(piece)

    def _lose(self, reason: str, kind: type[ArmError] = ArmError) -> ArmError:
        self._unknown = reason
        self._stream.close()
        return kind(
            f"arm at {self.endpoint} lost, its state is unknown: {reason}; look at the arm and its program"
        )


def connect(host: str, port: int, pace: Pace, setup: Setup) -> Arm:
    """Connect to an open_abb server, drain it and send all settings; nothing moves.

    Raises:
        PortError: nobody accepts the connection.
        ArmError: whoever answers is no open_abb server, or serves another client.
    """
    endpoint = f"tcp://{host}:{port}"
    hint = "start SERVER.mod and check its ipController"
    return over(lambda: open_tcp(host, port, endpoint, hint), pace, setup)


def over(open_stream: Callable[[], Stream], pace: Pace, setup: Setup) -> Arm:
    """The same over connections of any kind.

    The server makes its sockets anew after each client and cuts off who connected meanwhile: that is tried
    again.
    """
    tries = CONNECT_TRIES
    while True:
        stream = open_stream()
        try:
            return Arm(stream, pace, setup)
        except BaseException as error:  # Ctrl-C, too, must not leave the socket open
            stream.close()
            tries -= 1
            if not (tries and isinstance(error, _CutOffError)):
                raise
        pace.pause(ACCEPT_S)
