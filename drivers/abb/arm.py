"""Driver of an ABB arm behind an open_abb server: straight moves, each with a deadline.

The server has no stop command and answers nothing while the arm moves; a motion fault shows as silence. Once
an answer is overdue, the state of the arm is unknown, and `Arm` refuses every further request.
"""

import contextlib
import math
from collections.abc import Callable

from drivers.abb import codec
from drivers.abb.codec import Pose, ProtocolError, Reply
from drivers.abb.reach import Setup, setup_of
from drivers.abb.upright import Motion, UprightArm
from drivers.clock import Pace
from drivers.errors import ArmError, PortError, ReadOnlyError, read_late
from drivers.ports import TURN_RADIUS_MM
from drivers.stream import Stream, closed_on_error, open_tcp, tcp_address

ACCEPT_S = 0.5  # the server sleeps this long after accepting (SERVER.mod ServerCreateAndConnect)
STALE_S = 0.2  # a stale acknowledgement arrives within this time after that sleep
ANSWER_S = 2.0  # time limit for commands that do not move the arm
STARVED_S = 2.0  # wall: longest delay of a simulated controller
QUIET_S = 0.01  # wall: silence after which a reply is complete
CONNECT_TRIES = 3


class _CutOffError(ArmError):
    """The server closed the connection. This may happen just after connecting; `over` then connects again."""


class Arm(UprightArm):
    """Driver of an ABB arm over an open connection, which this object owns; `connect` creates both.

    The constructor sends the tool frame, the work object frame, a speed and the zone `fine` (a motion ends at
    rest), unless the setup is read-only. The limits of the setup are checked before every move.

    Raises:
        ArmError: the other side does not answer as an open_abb server.
    """

    look_at = "the arm and its program"

    _link: Stream

    def __init__(self, stream: Stream, pace: Pace, setup: Setup) -> None:
        super().__init__(stream.endpoint, stream, pace, setup)
        self._owed: tuple[int, float] | None = None  # code and deadline of a reply still to come
        self._text = ""  # received part of that reply
        self._late_s = 0.0  # how much too late the last reply was read
        self._speeds: tuple[float, float] | None = None
        self._drain()
        self._ask(codec.PING)
        if setup.read_only:
            return
        # All settings outlive a client: the server still has those of the previous one.
        self._ask(codec.SET_TOOL, codec.pose_numbers(setup.tool))
        self._ask(codec.SET_WORK_OBJECT, codec.pose_numbers(setup.work_object))
        self._set_speed(100.0, 100.0 / TURN_RADIUS_MM)
        self._ask(codec.SET_ZONE, ("1", "0", "0", "0"))  # fine: acknowledged at rest

    def _read_hand(self) -> Pose:
        """Reads the hand's pose from the server, with a resolution of 0.01 mm and about 1 mrad."""
        reply = self._ask(codec.READ_POSE)
        if self._late_s > 0.0:  # the reply is out of date
            reply = self._ask(codec.READ_POSE)
        if self._late_s > 0.0:
            raise ArmError(f"arm at {self.endpoint} {read_late(self._late_s)}")
        x_mm, y_mm, z_mm, w, x, y, z = codec.parse_numbers(reply)
        return Pose(x_mm, y_mm, z_mm, (w, x, y, z))

    def _read_last_axis(self) -> float:
        return math.radians(codec.parse_numbers(self._ask(codec.READ_JOINTS))[5])

    def _drive(self, motion: Motion) -> None:
        self._set_speed(motion.speed_mm_s, motion.turn_rad_s)
        self._ask(codec.MOVE_LINEAR, codec.pose_numbers(motion.target.frame), motion.budget_s)

    def close(self) -> None:
        """Disconnects without moving the arm.

        Sends no closing command if the state of the arm is unknown, for example after a missing reply.
        """
        if not self._unknown:
            with contextlib.suppress(OSError):
                self._link.send(codec.command(codec.CLOSE))
        super().close()

    def _set_speed(self, speed_mm_s: float, turn_rad_s: float) -> None:
        if (speed_mm_s, turn_rad_s) == self._speeds:
            return
        self._speeds = None  # until it is acknowledged
        self._ask(codec.SET_SPEED, codec.speed_numbers(speed_mm_s, turn_rad_s))
        self._speeds = speed_mm_s, turn_rad_s

    def _drain(self) -> None:
        """Waits until the server has started, and discards answers meant for its previous client."""
        until = self._pace.now() + (ACCEPT_S + STALE_S) / self._pace.time_scale
        while (left := until - self._pace.now()) > 0.0:
            try:
                self._link.receive(left)
            except OSError as error:
                raise self._lose("the connection broke", _CutOffError) from error

    def _ask(self, code: int, numbers: tuple[str, ...] = (), budget_s: float = ANSWER_S) -> Reply:
        self._check_known()
        line = codec.command(code, *numbers)
        message = repr(line.decode())
        if self._setup.read_only and code not in codec.HARMLESS:
            raise ReadOnlyError(f"a dry run was about to send {message} to arm {self.endpoint}")
        try:
            # After an interrupt the server may still be busy with the last command, and not
            # listening.
            reply = None
            if self._owed is None or self._await_reply(*self._owed) is not None:
                self._owed = (code, self._pace.deadline(budget_s, STARVED_S))
                self._link.send(line)
                reply = self._await_reply(*self._owed)
        except OSError as error:
            raise self._lose("the connection broke", _CutOffError) from error
        except ProtocolError as error:
            raise self._lose(f"an answer that does not fit: {error}") from error
        if reply is None:
            raise self._lose(f"{budget_s:.1f} s of silence after {message}")
        self._owed = None
        if not reply.done:
            raise ArmError(f"arm at {self.endpoint} refused {message} as a bad message")
        return reply

    def _await_reply(self, code: int, deadline: float) -> Reply | None:
        for left in self._pace.looks(deadline):
            reply = codec.parse_reply(self._text, code) if self._text else None
            if reply is not None and (reply.ended or not self._more(QUIET_S, code)):
                self._text = ""
                self._late_s = max(-left, 0.0)
                return reply
            if reply is None:
                self._more(max(left, 0.0), code)
        return None

    def _more(self, seconds: float, code: int) -> bool:
        """Appends received data to the reply to `code`; returns whether any data came within `seconds`."""
        piece = self._link.receive(seconds).decode("latin-1")
        self._text = codec.drop_stale(self._text + piece, code)
        return bool(piece)

    def _lose(self, reason: str, kind: type[ArmError] = ArmError) -> ArmError:
        self._link.close()
        return super()._lose(reason, kind)


def connect(url: str, pace: Pace, *, read_only: bool) -> Arm:
    """Connects to an open_abb server and, unless `read_only`, sends all settings; nothing moves.

    Raises:
        PortError: the connection is refused, or the address is invalid.
        ArmError: the other side is not an open_abb server, or serves another client.
    """
    setup = setup_of(url, read_only=read_only)
    if setup.reach_mm < math.inf:
        raise PortError(
            f"arm {url}: the reach of an arm at tcp:// is that of its model; leave it out"
        )
    endpoint = url.partition("?")[0]
    host, port = tcp_address(endpoint)
    hint = "start SERVER.mod and check its ipController"
    return over(lambda: open_tcp(host, port, endpoint, hint), pace, setup)


def over(open_stream: Callable[[], Stream], pace: Pace, setup: Setup) -> Arm:
    """Connects to an arm over a stream that `open_stream` opens; otherwise like `connect`.

    The server recreates its sockets after each client, and disconnects clients that connected meanwhile.
    After such a disconnection the stream is opened again, up to `CONNECT_TRIES` times in all.
    """

    def opened() -> Arm:
        stream = open_stream()
        with closed_on_error(stream):
            return Arm(stream, pace, setup)

    for _ in range(CONNECT_TRIES - 1):
        with contextlib.suppress(_CutOffError):
            return opened()
        pace.pause(ACCEPT_S)
    return opened()
