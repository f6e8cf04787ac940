"""An ABB arm behind an open_abb server: straight moves with deadlines, none after a silence.

The server has no stop command and answers nothing while it moves; a motion fault shows as silence. So a
silence makes the arm's state unknown, and this object refuses everything from then on.
"""

import contextlib
import math
import select
import socket
from typing import NamedTuple

from drivers.abb import codec
from drivers.abb.codec import IDENTITY, Pose, ProtocolError, Reply
from drivers.clock import LINK_TIMEOUT_S, Pace
from drivers.errors import ArmError, PortError, ReadOnlyError

ACCEPT_S = 0.5  # the server sleeps this long after accepting (SERVER.mod ServerCreateAndConnect)
STALE_S = 0.2  # and a stale acknowledgement follows at once
ANSWER_S = 2.0  # commands that do not move
MOVE_MARGIN_S = 3.0  # acceleration, fine point, network
QUIET_S = 0.01  # wall: a reply without terminator is whole when nothing follows it for so long
TURN_SPEED_DEG_S = 90.0
CONNECT_TRIES = 3
NOTHING_OWED = Reply(codec.PING, True, ())


class _CutOffError(ArmError):
    """The server hung up; on a fresh connection that is no news."""


class ArmPose(NamedTuple):
    """Where the hand is in the work object frame: mm, and its turn about the vertical in rad."""

    x_mm: float
    y_mm: float
    z_mm: float
    angle_rad: float


class Arm:
    """An arm on an open connection; `connect` opens one.

    Args:
        connection: a connected TCP socket; owned from now on.
        endpoint: the address as the user named it.
        pace: deadlines in the arm's own seconds.
        tool: tool frame (TCP midway between the finger tips).
        work_object: work object frame (the table).
        read_only: send no setting and refuse every command; poses are then in the frames the server has.

    Raises:
        ArmError: it does not answer as an open_abb server.
    """

    def __init__(
        self,
        connection: socket.socket,
        endpoint: str,
        pace: Pace,
        tool: Pose,
        work_object: Pose,
        *,
        read_only: bool = False,
    ) -> None:
        self.endpoint = endpoint
        self._socket = connection
        self._pace = pace
        self._read_only = read_only
        self._unknown = ""  # why the state is unknown
        self._owed: tuple[int, float] | None = None  # code and deadline of a reply still to come
        self._text = ""
        self._speed = math.nan
        self._at: ArmPose | None = None
        self._drain()
        self._ask(codec.PING, (), ANSWER_S)
        if not read_only:
            self._send_settings(tool, work_object)

    def _send_settings(self, tool: Pose, work_object: Pose) -> None:
        # All settings outlive a client: the server still has those of whoever was here before.
        self._ask(codec.SET_TOOL, codec.pose_numbers(tool), ANSWER_S)
        self._ask(codec.SET_WORK_OBJECT, codec.pose_numbers(work_object), ANSWER_S)
        self._set_speed(100.0)
        self._ask(codec.SET_ZONE, ("1", "0", "0", "0"), ANSWER_S)  # fine: acknowledged when it stands

    def pose(self) -> ArmPose:
        """Read where the hand is (0.01 mm, about 1 mrad).

        Raises:
            ArmError: the arm is silent, or its hand does not point down.
        """
        reply = self._ask(codec.READ_POSE, (), ANSWER_S)
        try:
            seen = codec.parse_pose(reply)
            self._at = ArmPose(seen.x_mm, seen.y_mm, seen.z_mm, codec.hand_angle(seen.rotation))
        except ProtocolError as error:
            raise ArmError(f"arm at {self.endpoint}: {error}", str(codec.READ_POSE)) from error
        return self._at

    def move_linear(self, x_mm: float, y_mm: float, z_mm: float, angle_rad: float, speed_mm_s: float) -> None:
        """Move the hand in a straight line and return when it stands.

        Args:
            x_mm: the point midway between the finger tips, work object frame.
            y_mm: the same.
            z_mm: the same.
            angle_rad: the hand's turn about the vertical; it points down.
            speed_mm_s: speed along the path.

        Raises:
            ArmError: a number cannot be sent, the arm refuses it, or does not arrive in time; then its state
            is
                unknown and every further call is refused.
        """
        target = ArmPose(x_mm, y_mm, z_mm, angle_rad)
        try:
            numbers = codec.pose_numbers(Pose(x_mm, y_mm, z_mm, codec.hand_rotation(angle_rad)))
        except (ProtocolError, ValueError) as error:
            raise ArmError(f"arm not moved: {error}", str(codec.MOVE_LINEAR)) from error
        start = self._at or self.pose()
        self._set_speed(speed_mm_s)
        self._at = None
        self._ask(codec.MOVE_LINEAR, numbers, travel_s(start, target, speed_mm_s) * 1.5 + MOVE_MARGIN_S)
        self._at = target

    def close(self) -> None:
        """Hang up; the arm does not move. A silent one is left without a word."""
        if not self._unknown:
            with contextlib.suppress(OSError):
                self._socket.sendall(codec.command(codec.CLOSE))
        self._unknown = self._unknown or "it was closed"
        self._socket.close()

    def _set_speed(self, speed_mm_s: float) -> None:
        if speed_mm_s == self._speed:
            return
        if not speed_mm_s > 0.0:
            raise ArmError(f"arm speed {speed_mm_s} mm/s; give a positive one", str(codec.SET_SPEED))
        try:
            numbers = (codec.number(speed_mm_s, 3), codec.number(TURN_SPEED_DEG_S, 3))
        except ProtocolError as error:
            raise ArmError(f"arm speed: {error}", str(codec.SET_SPEED)) from error
        self._ask(codec.SET_SPEED, numbers, ANSWER_S)
        self._speed = speed_mm_s

    def _drain(self) -> None:
        """Wait out the server's start and throw away what it still had to tell its last client."""
        until = self._pace.now() + (ACCEPT_S + STALE_S) / self._pace.time_scale
        while (left := until - self._pace.now()) > 0.0:
            try:
                if self._readable(left) and not self._receive():
                    raise ConnectionResetError("closed by the arm")
            except OSError as error:
                raise self._lose("the connection broke", b"", _CutOffError) from error

    def _ask(self, code: int, numbers: tuple[str, ...], budget_s: float) -> Reply:
        """Send one command in one piece and wait for its own reply."""
        if self._unknown:
            raise ArmError(
                f"arm at {self.endpoint}: state unknown since {self._unknown}; "
                "look at the arm, then connect again"
            )
        line = codec.command(code, *numbers)
        if self._read_only and code not in codec.HARMLESS:
            raise ReadOnlyError(
                f"a dry run was about to send {line.decode()!r} to the arm at {self.endpoint}"
            )
        try:
            # After an interrupt the server may still be busy with the last command: it cannot listen before.
            reply = self._await_reply(*self._owed) if self._owed else NOTHING_OWED
            if reply is not None:
                self._owed = (code, self._pace.deadline(budget_s))
                self._socket.sendall(line)
                reply = self._await_reply(*self._owed)
        except OSError as error:
            raise self._lose("the connection broke", line, _CutOffError) from error
        except ProtocolError as error:
            raise self._lose(f"an answer that does not fit: {error}", line) from error
        if reply is None:
            raise self._lose(f"{budget_s:.1f} s of silence after {line.decode()!r}", line)
        self._owed = None
        if not reply.done:
            raise ArmError(
                f"arm at {self.endpoint} refused {line.decode()!r} as a bad message", line.decode()
            )
        return reply

    def _await_reply(self, code: int, deadline: float) -> Reply | None:
        while (left := deadline - self._pace.now()) > 0.0:
            reply = codec.parse_reply(self._text, code) if self._text else None
            if reply is not None and not (reply.fields and self._readable(QUIET_S)):
                self._text = ""
                return reply
            if self._readable(left):
                piece = self._receive()
                if not piece:
                    raise ConnectionResetError("closed by the arm")
                self._text = codec.drop_stale(self._text + piece, code)
        return None

    def _readable(self, seconds: float) -> bool:
        return bool(select.select([self._socket], [], [], max(seconds, 0.0))[0])

    def _receive(self) -> str:
        return self._socket.recv(256).decode("latin-1")

    def _lose(self, reason: str, line: bytes, kind: type[ArmError] = ArmError) -> ArmError:
        self._unknown = reason
        self._socket.close()
        return kind(
            f"arm at {self.endpoint} lost, its state is unknown: {reason}; look at the arm and its program",
            line.decode("ascii"),
        )


def travel_s(start: ArmPose, target: ArmPose, speed_mm_s: float) -> float:
    """Seconds a straight move takes: the slower of path and turn."""
    path_mm = math.dist(start[:3], target[:3])
    turn_deg = math.degrees(abs(math.remainder(target.angle_rad - start.angle_rad, 2.0 * math.pi)))
    return max(path_mm / speed_mm_s, turn_deg / TURN_SPEED_DEG_S)


def connect(
    host: str,
    port: int,
    pace: Pace,
    tool: Pose = IDENTITY,
    work_object: Pose = IDENTITY,
    *,
    read_only: bool = False,
) -> Arm:
    """Connect to an open_abb server, drain it and send all settings (unless `read_only`); nothing moves.

    The server makes its sockets anew after each client and cuts off who connected meanwhile: that is tried
    again.

    Raises:
        PortError: nobody accepts the connection.
        ArmError: whoever answers is no open_abb server, or serves another client.
    """
    for _ in range(CONNECT_TRIES - 1):
        with contextlib.suppress(_CutOffError):
            return _connect_once(host, port, pace, tool, work_object, read_only=read_only)
        pace.pause(ACCEPT_S)
    return _connect_once(host, port, pace, tool, work_object, read_only=read_only)


def _connect_once(host: str, port: int, pace: Pace, tool: Pose, work_object: Pose, *, read_only: bool) -> Arm:
    endpoint = f"tcp://{host}:{port}"
    try:
        connection = socket.create_connection((host, port), timeout=5.0)
    except OSError as error:
        raise PortError(
            f"nobody accepts a connection at {endpoint} ({error.strerror or error}); "
            "start SERVER.mod and check its ipController",
            endpoint,
        ) from error
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.settimeout(LINK_TIMEOUT_S)
    try:
        return Arm(connection, endpoint, pace, tool, work_object, read_only=read_only)
    except BaseException:
        connection.close()
        raise
