"""The open_abb server (`RAPID/SERVER.mod`) and its IRB 120, simulated over time; without sockets."""

import bisect
import math
import random
from typing import NamedTuple

from drivers.abb import kinematics
from drivers.abb.codec import IDENTITY, Pose, Quaternion
from drivers.abb.kinematics import compose, invert
from drivers.sim.devices import rapid
from drivers.sim.faults import Channel, Desk, Listed

ACCEPT_S = 0.5  # WaitTime after SocketAccept in ServerCreateAndConnect
MAX_STRING = 80  # most characters that SocketReceive \Str accepts at once
MAX_BUFFER = 512
JOINT_SPEED_DEG_S = 250.0  # IRB 120, slowest of its main axes
UNIT_TOLERANCE = 1e-3  # deviation from unit length that RAPID accepts in a quaternion
INFO = "120-000000*ROBOTWARE_6.05.00.00*120-3/0.58"
HOME_MM = (0.0, 0.0, 100.0)  # pose of the hand at the start, pointing down
SOON_S = 0.002  # time over which a speed is measured
STALE = "1 1 "  # the acknowledgement of a MoveL
HAND_DOWN: Quaternion = (0.0, 1.0, 0.0, 0.0)

# Number of parameters of each instruction: the TEST of SERVER.mod main.
TAKEN: dict[float, tuple[int, ...]] = {
    **dict.fromkeys((0, 3, 4, 5, 31, 32, 33, 98, 99), (0,)),
    **dict.fromkeys((1, 6, 7, 30, 35, 36), (7,)),
    **dict.fromkeys((2, 34), (6,)),
    8: (2, 4),
    9: (4,),
}


class Answer(NamedTuple):
    """What the server sends after an instruction, and when."""

    text: str | None  # what is sent; None: nothing, the server disconnects
    ready_s: float  # time of the answer; infinity: never, RAPID execution has stopped
    broken: bool = False  # the connection breaks at once, the motion goes on
    before: str = ""  # text that is sent first, though it answers nothing


class Leg(NamedTuple):
    """A motion of the flange in the base frame, with the joints at both ends, whole turns counted."""

    start: Pose
    target: Pose
    start_s: float
    seconds: float
    joints_deg: kinematics.Joints
    ends_deg: kinematics.Joints
    ramp_s: float = 0.0  # duration of the acceleration, and of the deceleration
    brakes: bool = False  # whether it starts at full speed and decelerates all the way

    def at(self, now_s: float) -> Pose:
        """Returns the pose of the flange at a time."""
        share = self.share(now_s)
        return self.target if share == 1.0 else kinematics.between(self.start, self.target, share)

    def joints_at(self, now_s: float) -> kinematics.Joints:
        """Returns the joints at a time, in degrees, whole turns counted."""
        share = self.share(now_s)
        if share == 1.0:
            return self.ends_deg
        *_, joints = kinematics.track(self.joints_deg, self.start, self.target, share)
        return joints or self.joints_deg

    def share(self, now_s: float) -> float:
        """Share of the way that is done at a time, from 0 to 1."""
        if now_s >= self.start_s + self.seconds:
            return 1.0
        since, ramp, flat = max(now_s - self.start_s, 0.0), self.ramp_s, self.seconds - self.ramp_s
        if self.brakes:
            return 1.0 - (1.0 - since / self.seconds) ** 2
        if since < ramp:
            return 0.5 * since**2 / (ramp * flat)
        if since > flat:
            return 1.0 - 0.5 * (self.seconds - since) ** 2 / (ramp * flat)
        return (since - 0.5 * ramp) / flat


class HaltError(Exception):
    """A fault that stops RAPID execution: the connection stays open and mute."""


class ArmModel:
    """State of the open_abb server and of its arm.

    Each received instruction counts as one event of the fault schedule; the faults scheduled for this event
    take effect.

    Args:
        base: the arm's base frame in the world.
        acceleration: acceleration of straight motions, mm/s2 and deg/s2; None: the arm reaches its speed at
            once.
        desk: gives the current faults; None: there are no faults.
        seed: seed of displacements of the hand.
    """

    def __init__(
        self,
        base: Pose,
        acceleration: tuple[float, float] | None = None,
        desk: Desk | None = None,
        seed: int = 0,
    ) -> None:
        self._acceleration = acceleration
        self._desk, self._rng = desk or Desk(Listed()), random.Random(f"{seed}/arm")
        self.halted = ""  # why RAPID execution has stopped; empty: it runs
        self.moves = 0  # number of motions so far
        self._base = base
        self._message = rapid.Message()
        self._tool = IDENTITY
        self._work_object = IDENTITY
        self._speed = (100.0, 50.0)  # mm/s, deg/s
        self._zone_mm = 0.3
        self._buffer: list[tuple[Pose, tuple[float, float]]] = []
        self._external: tuple[float, ...] = (0.0,) * 6
        self._circle: Pose | None = None
        here = compose(invert(base), Pose(*HOME_MM, HAND_DOWN))
        joints = kinematics.inverse(here) or (0.0,) * 6
        self._legs = [Leg(here, here, 0.0, 0.0, joints, joints)]

    def pose_at(self, now_s: float) -> Pose:
        """Pose of the client's tool in the client's work object at a time."""
        flange = compose(self._base, self.flange_at(now_s))
        return compose(invert(self._work_object), compose(flange, self._tool))

    def joints_at(self, now_s: float) -> tuple[float, ...]:
        """Returns the joints at a time, in degrees, whole turns counted."""
        return self._leg(now_s).joints_at(now_s)

    def frames(self, tool: Pose, work_object: Pose) -> None:
        """Sets the tool in the flange frame and the work object in the world."""
        self._tool, self._work_object = _unit(tool), _unit(work_object)

    def line(self, tip: Pose, speed: tuple[float, float], now_s: float) -> float:
        """Moves in a straight line, at speeds in mm/s and deg/s, to a stop; returns the time of arrival.

        Raises:
            HaltError: the arm cannot move there, or a speed is not positive.
        """
        self._zone_mm = 0.0
        return self._line(tip, speed, now_s)[1]

    def stop(self, now_s: float, seconds: float = 0.0) -> None:
        """Stops the arm on its path: at once, or with a constant deceleration for `seconds`."""
        here, joints, leg = self.flange_at(now_s), self.joints_at(now_s), self._leg(now_s)
        target, ends = here, joints
        if seconds > 0.0:
            share, soon = leg.share(now_s), leg.share(now_s + SOON_S)
            last = min(share + 0.5 * seconds * (soon - share) / SOON_S, 1.0)
            target = kinematics.between(leg.start, leg.target, last)
            *_, reached = kinematics.track(joints, here, target)
            ends = reached or joints
        begun = [leg for leg in self._legs if leg.start_s <= now_s]
        self._legs = [*begun, Leg(here, target, now_s, seconds, joints, ends, brakes=True)]

    def displace(self, by: tuple[float, float, float, float], moment_s: float) -> bool:
        """Displaces the hand at once by x, y, z [mm] and a turn [rad], unless the new pose is out of reach.

        Returns:
            Whether the hand was moved.
        """
        hand, joints = self.pose_at(moment_s), self.joints_at(moment_s)
        half_rad = by[3] / 2.0
        turn = (math.cos(half_rad), 0.0, 0.0, math.sin(half_rad))
        rotation = kinematics.multiply(turn, hand.rotation)
        moved = Pose(hand.x_mm + by[0], hand.y_mm + by[1], hand.z_mm + by[2], rotation)
        target = self._flange_target(moved)
        *_, ends = kinematics.track(joints, self.flange_at(moment_s), target)
        if ends is None:
            return False
        self._go(Leg(target, target, moment_s, 0.0, ends, ends))
        return True

    def flange_at(self, now_s: float) -> Pose:
        """Pose of the flange in the base frame at a time."""
        return self._leg(now_s).at(now_s)

    def execute(self, text: str, now_s: float) -> Answer:
        """Executes one received string; does nothing after the program has halted.

        Raises:
            RapidError: there are too many parameters; the server then disconnects and listens again.
        """
        self._desk.next(Channel.ARM)
        kinds = {fault.kind for fault in self._desk.holding(Channel.ARM)}
        if "arm_silent" in kinds:
            self.halted = "program stopped"
        elif "arm_unreachable" in kinds:
            self.halted = "50050 position outside reach"
        if self.halted:
            return Answer(None, math.inf)
        if "arm_refuses" in kinds:
            return Answer(f"{text.split(' ', 1)[0].lstrip('0') or '0'} 0 ", now_s)
        answer = self._answer(text, now_s)
        self._displace_hand(answer.ready_s)
        if "arm_disconnect" in kinds:
            return answer._replace(broken=True)
        return answer._replace(before=STALE) if "arm_stale_ack" in kinds else answer

    def _displace_hand(self, moment_s: float) -> None:
        """Displaces or turns the hand if a scheduled fault of that kind begins with this instruction.

        The controller knows the new pose, but did not command it.
        """
        for fault in self._desk.beginning(Channel.ARM):
            if fault.kind == "arm_displaced":
                bearing = self._rng.uniform(-math.pi, math.pi)
                aside = (fault.value * math.cos(bearing), fault.value * math.sin(bearing))
                self.displace((*aside, 0.0, 0.0), moment_s)
            elif fault.kind == "arm_turned":
                turn_rad = math.copysign(math.radians(fault.value), self._rng.uniform(-1.0, 1.0))
                self.displace((0.0, 0.0, 0.0, turn_rad), moment_s)

    def _answer(self, text: str, now_s: float) -> Answer:
        self._message.parse(text)
        message = self._message
        code = rapid.to_string(message.code, 0)
        if message.count not in TAKEN.get(message.code, ()):
            return Answer(f"{code} 0 ", now_s)
        if message.code == 99:
            return Answer(None, now_s)
        try:
            ready_s = self._run(message.code, tuple(message.parameters[: message.count]), now_s)
        except HaltError as halt:
            self.halted = str(halt)
            return Answer(None, math.inf)
        return Answer(f"{code} 1 {self._payload(message.code, now_s)}", ready_s)

    def _payload(self, code: float, now_s: float) -> str:
        """Payload of the answer to an instruction: the data that the instruction requests, if any."""
        if code == 3:
            return rapid.pose_string(self.pose_at(now_s), 2)
        if code == 4:
            return " ".join(rapid.to_string(angle, 2) for angle in self.joints_at(now_s))
        if code == 5:
            return " ".join(rapid.to_string(value, 2)[:8] for value in self._external)
        return {32: rapid.to_string(len(self._buffer), 2), 98: INFO}.get(int(code), "")

    def _run(self, code: float, values: tuple[float, ...], now_s: float) -> float:
        """Executes an instruction; returns the time at which the next one may start."""
        match code:
            case 1:
                return self._line(_pose(values), self._speed, now_s)[0]
            case 2:
                return self._move_joints(values, now_s)
            case 6:
                self._tool = _unit(_pose(values))
            case 7:
                self._work_object = _unit(_pose(values))
            case 8:
                self._speed = (values[0], values[1])
            case 9:
                self._zone_mm = 0.0 if values[0] == 1.0 else values[1]
            # the 513th is dropped and acknowledged all the same
            case 30 if len(self._buffer) < MAX_BUFFER:
                self._buffer.append((_pose(values), self._speed))
            case 31:
                self._buffer.clear()
            case 33:
                for tip, speed in self._buffer:
                    now_s = self._line(tip, speed, now_s)[0]
            case 34:
                self._external = values
            case 35:
                self._circle = _pose(values)
            case 36:
                return self._move_circle(_pose(values), now_s)
        return now_s

    # -- motion -----------------------------------------------------------------------------------

    def _leg(self, now_s: float) -> Leg:
        index = bisect.bisect_right(self._legs, now_s, key=lambda leg: leg.start_s) - 1
        return self._legs[max(index, 0)]

    def _flange_target(self, tip: Pose) -> Pose:
        """Pose of the flange in the base frame at which the tool is at `tip` in the work object."""
        world = compose(compose(self._work_object, _unit(tip)), invert(self._tool))
        return compose(invert(self._base), world)

    def _drive(self, target: Pose, seconds: float, now_s: float, ramp_s: float = 0.0) -> float:
        """Adds a straight motion that starts at `now_s`; returns the time of its end.

        Raises:
            HaltError: a point of the motion is out of reach, or beyond the limits of a joint.
        """
        here, joints = self.flange_at(now_s), self.joints_at(now_s)
        ends = joints
        for step in kinematics.track(joints, here, target):
            if step is None:
                raise HaltError("50050 position outside reach")
            if not kinematics.within_limits(step):
                raise HaltError("50027 joint out of range")
            ends = step
        return self._go(Leg(here, target, now_s, seconds, joints, ends, ramp_s))

    def _go(self, leg: Leg) -> float:
        self._legs = [*self._legs[-8:], leg]
        self.moves += 1
        return leg.start_s + leg.seconds

    def _line(self, tip: Pose, speed: tuple[float, float], now_s: float) -> tuple[float, float]:
        """Executes a MoveL; returns when the next instruction may start, and when the motion ends."""
        target = self._flange_target(tip)
        if min(speed) <= 0.0:
            raise HaltError("50204 speed is not positive")
        here = self.pose_at(now_s)
        path_mm = math.dist(here[:3], tip[:3])
        turn_deg = math.degrees(kinematics.turn_between(here.rotation, _unit(tip).rotation))
        seconds, ramp_s = self._profile((path_mm, turn_deg), speed)
        end_s = self._drive(target, seconds, now_s, ramp_s)
        # A fly-by point lets the program go on when its zone is entered, at most half way.
        early = min(self._zone_mm / path_mm, 0.5) * seconds if path_mm > 0.0 else 0.0
        return end_s - early, end_s

    def _profile(
        self, ways: tuple[float, float], speeds: tuple[float, float]
    ) -> tuple[float, float]:
        """Durations of a straight motion and of its acceleration, s; the slower of path and turn decides.

        Args:
            ways: length of the path and angle of the turn, mm and deg.
            speeds: speeds of path and turn, mm/s and deg/s.
        """
        if self._acceleration is None:
            return max(way / speed for way, speed in zip(ways, speeds, strict=True)), 0.0
        results = []
        for way, speed, acceleration in zip(ways, speeds, self._acceleration, strict=True):
            ramp_s = min(speed / acceleration, math.sqrt(way / acceleration))
            results.append((ramp_s + way / (ramp_s * acceleration) if way > 0.0 else 0.0, ramp_s))
        return max(results)

    def _move_circle(self, end: Pose, now_s: float) -> float:
        """Executes a MoveC as two chords through the via-point; returns the time of its end."""
        if self._circle is None:
            raise HaltError("50066 circle point not defined")
        for tip in (self._circle, end):
            now_s = self._line(tip, self._speed, now_s)[1]
        return now_s

    def _move_joints(self, values: tuple[float, ...], now_s: float) -> float:
        if not kinematics.within_limits(values):
            raise HaltError("50027 joint out of range")
        here, now = self.flange_at(now_s), self.joints_at(now_s)
        seconds = max(abs(a - b) for a, b in zip(values, now, strict=True)) / JOINT_SPEED_DEG_S
        return self._go(Leg(here, kinematics.forward(values), now_s, seconds, now, values))


def _pose(values: tuple[float, ...]) -> Pose:
    x, y, z, a, b, c, d = values
    return Pose(x, y, z, (a, b, c, d))


def _unit(pose: Pose) -> Pose:
    length = math.sqrt(sum(part * part for part in pose.rotation))
    if abs(length - 1.0) > UNIT_TOLERANCE:
        raise HaltError("40512 orientation value is not normalised")
    w, x, y, z = (part / length for part in pose.rotation)
    return Pose(*pose[:3], (w, x, y, z))
