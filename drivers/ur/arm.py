"""Driver of a UR arm: reads by RTDE, and sends a short program for each motion to the secondary interface.

Connecting only reads. A motion is refused while another program runs, and stopped when it is interrupted or
late. Two registers report the start and the end of a motion; only programs of this driver write them.
"""

import contextlib
import math
import secrets
from collections.abc import Callable
from functools import partial

from drivers.abb.codec import Pose
from drivers.abb.kinematics import compose, invert
from drivers.abb.reach import Setup, setup_of, within_sphere
from drivers.abb.upright import Motion, UprightArm
from drivers.clock import Pace
from drivers.errors import ArmError, PortError
from drivers.stream import Stream, closed_on_error, open_tcp, tcp_address
from drivers.ur import script
from drivers.ur.rtde import ANSWER_S, PORT, Reading, Rtde

SCRIPT_PORT_BELOW = 2  # the secondary interface, 30002, beside RTDE's 30004
READY = 7  # robot mode: powered, brakes released
PROGRAM_RUNS = 0b10  # bit of the status
MAY_MOVE = 0b11  # safety bits with which the arm may move: normal or reduced, and nothing else
SAFETY = (
    "normal",
    "reduced mode",
    "protective stop",
    "recovery mode",
    "safeguard stop",
    "system emergency stop",
    "robot emergency stop",
    "emergency stop",
    "violation",
    "fault",
    "stopped due to safety",
)
PAUSED = frozenset({3, 4})  # runtime states: pausing, paused
LEAST_FRACTION = 0.05  # least position of the speed slider; below it no deadline is useful
STILL_M_S = 0.002
WHOLE_TURN_MARGIN = 2.0  # factor by which a motion of given duration may be faster in its middle
REMOTE = (
    "set the pendant to Remote Control, and see that port 30002 is not blocked (Settings, Security)"
)
HINT = "check the address and that RTDE is enabled (Settings, Security, Services)"


class Arm(UprightArm):
    """Driver of a UR arm over an open RTDE connection, which this object owns; `connect` creates both.

    Args:
        stream: connection to RTDE.
        open_script: connects to the secondary interface.
        pace: device time.
        setup: frames and limits.

    Raises:
        ArmError: the other side does not answer as a UR controller.
    """

    def __init__(
        self, stream: Stream, open_script: Callable[[], Stream], pace: Pace, setup: Setup
    ) -> None:
        # The forearm passes beside the axis of the base: axis 1 turns by more than the hand's bearing.
        super().__init__(stream.endpoint, stream, pace, setup, within_sphere(setup))
        self._open_script = open_script
        self._displaced = False  # whether another program replaced this driver's
        self._fraction = 1.0  # position of the speed slider at the start of the last motion
        # Number of the last move; starts at random, not to repeat the numbers of an earlier client.
        self._moves = secrets.randbelow(1 << 30)
        try:
            self._rtde = Rtde(stream, pace)
        except OSError as error:
            raise self._lose(str(error)) from error

    def _read_hand(self) -> Pose:
        seen = self._read()
        # The pose is the pose of the controller's active tool, which may differ from the setup's tool.
        flange = compose(script.frame(seen.tcp), invert(script.frame(seen.tcp_offset)))
        return self._setup.hand_at(flange)

    def _read_last_axis(self) -> float:
        return self._read().joints[5]

    def _drive(self, motion: Motion) -> None:
        seen = self._read()
        if reason := _objection(seen):
            raise ArmError(f"arm at {self.endpoint} not moved: {reason}")
        pacing, seconds = _pacing(motion)
        # The pendant's speed slider slows a program down.
        self._fraction = seen.speed_fraction
        budget_s = max(motion.budget_s, seconds + ANSWER_S) / seen.speed_fraction
        self._moves = self._moves % (1 << 30) + 1
        place = compose(self._setup.table, motion.target.frame)
        program = script.move(self._moves, self._setup.tool, place, pacing)
        try:
            opened = self._open_script()
        except PortError as error:
            raise ArmError(f"arm at {self.endpoint} not moved: {error}") from error

        def stop() -> None:
            if not self._displaced:
                opened.send(script.stop())

        with contextlib.closing(opened), self._stopped_on_error(stop):
            opened.send(program)
            self._await_start()
            self._await_end(budget_s)

    def _await_start(self) -> None:
        for _ in self._pace.polls(self._pace.deadline(ANSWER_S)):
            seen = self._read()
            if seen.started == self._moves:
                return
        raise self._lose(f"it did not take a program; {_hold(seen) or REMOTE}")

    def _await_end(self, budget_s: float) -> None:
        for _ in self._pace.polls(self._pace.deadline(budget_s)):
            seen = self._read()
            runs = seen.status_bits & PROGRAM_RUNS or seen.runtime_state in PAUSED
            if seen.started != self._moves:
                self._displaced = True  # another program, which must not be stopped
                raise self._lose("another program moves it")
            ended, still = seen.done == self._moves, math.hypot(*seen.tcp_speed[:3]) < STILL_M_S
            if ended and still and not runs:
                return
            if not ended and not runs:
                reason = _stop(seen) or "stopped by somebody"
                raise self._lose(f"its program ended on the way ({reason})")
        held = _hold(seen)
        if not held and seen.speed_fraction < self._fraction:
            held = f"the speed slider was lowered to {100.0 * seen.speed_fraction:.0f} %"
        raise self._lose(f"not there after {budget_s:.1f} s ({held or 'nothing tells why'})")

    def _read(self) -> Reading:
        self._check_known()
        try:
            return self._rtde.read()
        except OSError as error:
            raise self._lose(str(error)) from error


def _pacing(motion: Motion) -> tuple[str, float]:
    """Returns the argument of `movel` that sets the pace of a motion, and the duration without ramps, s.

    `movel` limits only the speed of the tool's point, so a motion that mostly turns gets a duration instead.
    """
    path_s = math.dist(motion.start[:3], motion.target[:3]) / motion.speed_mm_s
    turn_s = abs(motion.target.angle_rad - motion.start.angle_rad) / motion.turn_rad_s
    if path_s >= turn_s:
        return f"v={motion.speed_mm_s / 1000.0:.6f}", path_s
    seconds = WHOLE_TURN_MARGIN * turn_s
    return f"t={max(seconds, 0.1):.4f}", seconds


def _objection(seen: Reading) -> str:
    """Returns why the arm may not be moved; empty if it may."""
    runs = "a program runs on the controller; stop it first"
    return _stop(seen) or (runs if seen.status_bits & PROGRAM_RUNS else _slider(seen))


def _hold(seen: Reading) -> str:
    """Returns why a program of this driver does not continue; empty if the controller reports no reason."""
    paused = "the program is paused on the pendant; stop it there"
    return _stop(seen) or (paused if seen.runtime_state in PAUSED else _slider(seen))


def _stop(seen: Reading) -> str:
    """Returns which stop or mode keeps the arm from moving, and the remedy; empty if the arm is ready."""
    if seen.safety_bits & ~MAY_MOVE or not seen.safety_bits & MAY_MOVE:
        stops = (name for bit, name in enumerate(SAFETY) if bit > 1 and seen.safety_bits >> bit & 1)
        return f"{', '.join(stops) or 'safety state unknown'}; put it right on the pendant"
    if seen.mode != READY:
        return f"it is not ready (robot mode {seen.mode}); power it on and release the brakes"
    return ""


def _slider(seen: Reading) -> str:
    if not LEAST_FRACTION <= seen.speed_fraction <= 1.0:
        return f"the speed slider stands at {100.0 * seen.speed_fraction:.0f} %; raise it"
    return ""


def connect(url: str, pace: Pace, *, read_only: bool) -> Arm:
    """Connects to a controller; only reads, and moves nothing.

    Raises:
        PortError: the connection is refused, or the address is invalid.
        ArmError: the other side is not a UR controller.
    """
    setup = setup_of(url, read_only=read_only)
    host, port = tcp_address(url.partition("?")[0], PORT)
    endpoint = f"ur://{host}:{port}"
    script_port = port - SCRIPT_PORT_BELOW
    hint = "enable the secondary interface (Settings, Security, Services)"
    stream = open_tcp(host, port, endpoint, HINT)
    with closed_on_error(stream):
        open_script = partial(open_tcp, host, script_port, f"{host}:{script_port}", hint)
        return Arm(stream, open_script, pace, setup)
