"""A simulated UR controller: its state, and the execution of programs.

It moves the simulated ABB arm. A program is a list of `set_tcp`, `movel`, `stopl` and
`write_output_integer_register`; a program with any other statement is ignored, as a real controller ignores
one with a syntax error. A new program replaces the running one, and stops the arm at once, or brakes it if
the program begins with `stopl`.
"""

import math
import re
from collections.abc import Callable

from drivers.abb.codec import IDENTITY, Pose
from drivers.abb.kinematics import compose, turn_between
from drivers.sim.devices.arm import SOON_S, ArmModel, HaltError
from drivers.ur import script

STATEMENT = re.compile(r"(\w+)\((.*)\)")
POSE = re.compile(r"p\[([^\]]*)\]")
NORMAL, PROTECTIVE_STOP = 0b1, 0b100
POWERED, RUNS = 0b1, 0b10
STOPPED, PLAYING = 1, 2  # runtime states
Fields = dict[str, tuple[str, tuple[float, ...]]]


class UrModel:
    """State of a UR controller.

    Args:
        arm: mechanics of the arm; only this controller moves it.
        base: the arm's base frame in the world, which programs use.
        executed: called at the end of each `advance`, unless a motion is then under way.
    """

    def __init__(
        self, arm: ArmModel, base: Pose, executed: Callable[[], None] = lambda: None
    ) -> None:
        self.remote = True  # whether remote programs are accepted
        self.mode, self.safety_bits = 7, NORMAL
        self.speed_fraction = 1.0
        self.registers = dict.fromkeys(range(48), 0)
        self._arm, self._base, self._executed = arm, base, executed
        self._tool = IDENTITY
        # Moment, register, value: remaining writes of the program.
        self._events: list[tuple[float, int, int]] = []
        self._ends_s = 0.0
        self._motion_ends_s = 0.0

    def take(self, program: str, now_s: float) -> None:
        """Receives a program on the secondary interface; ignores it if it is invalid or cannot run now."""
        statements = _parsed(program)
        if not (self.remote and statements and self.safety_bits == NORMAL and self.mode == 7):
            return
        self.advance(now_s)
        if statements[0][0] == "stopl":
            self._events.clear()
        else:
            self._halt(now_s)
        at_s = now_s
        for name, words in statements:
            at_s = self._run(name, words, at_s)
            if self.safety_bits != NORMAL:
                break
        self._ends_s = at_s

    def advance(self, now_s: float) -> None:
        """Advances time to `now_s`, and executes the register writes that are due."""
        while self._events and self._events[0][0] <= now_s:
            _, register, value = self._events.pop(0)
            self.registers[register] = value
        if self._motion_ends_s <= now_s:
            self._executed()

    def fields(self, now_s: float) -> Fields:
        """All available output fields at a time, by name: the type and the values of each."""
        self.advance(now_s)
        pose, (*speed, turning) = self._tcp_at(now_s), self._speeds_at(now_s)
        runs = now_s < self._ends_s
        joints = tuple(math.radians(angle) for angle in self._arm.joints_at(now_s))
        fields: Fields = {
            "timestamp": ("DOUBLE", (now_s,)),
            "actual_TCP_pose": ("VECTOR6D", _vector(pose)),
            "actual_TCP_speed": ("VECTOR6D", (*speed, 0.0, 0.0, turning)),
            "actual_q": ("VECTOR6D", joints),
            "tcp_offset": ("VECTOR6D", _vector(self._tool)),
            "robot_mode": ("INT32", (self.mode,)),
            "robot_status_bits": ("UINT32", (POWERED | RUNS if runs else POWERED,)),
            "safety_status_bits": ("UINT32", (self.safety_bits,)),
            "runtime_state": ("UINT32", (PLAYING if runs else STOPPED,)),
            "target_speed_fraction": ("DOUBLE", (self.speed_fraction,)),
        }
        for number, value in self.registers.items():
            fields[f"output_int_register_{number}"] = ("INT32", (value,))
        return fields

    def _tcp_at(self, now_s: float) -> Pose:
        """Pose of the active tool in the base frame."""
        return compose(self._arm.flange_at(now_s), self._tool)

    def _speeds_at(self, now_s: float) -> tuple[float, float, float, float]:
        """Velocity of the active tool in the base frame, m/s, and the speed of its turn, rad/s."""
        pose, soon = self._tcp_at(now_s), self._tcp_at(now_s + SOON_S)
        x, y, z = ((b - a) / 1e3 / SOON_S for a, b in zip(pose[:3], soon[:3], strict=True))
        return x, y, z, turn_between(pose.rotation, soon.rotation) / SOON_S

    def _halt(self, now_s: float) -> None:
        self._events.clear()
        self._arm.stop(now_s)
        self._ends_s = self._motion_ends_s = now_s

    def _run(self, name: str, words: str, at_s: float) -> float:
        """Executes one statement; returns the time at which the next statement may start."""
        if name == "set_tcp":
            self._tool = _pose(words)
        elif name == "write_output_integer_register":
            register, value = (int(word) for word in words.split(","))
            self._events.append((at_s, register, value))
        elif name == "stopl":
            *speed, turning = self._speeds_at(at_s)
            rates = [float(word) for word in re.findall(r"[\d.]+", words)]  # m/s2, rad/s2
            seconds = max(math.hypot(*speed) / rates[0], turning / rates[-1])
            self._arm.stop(at_s, seconds)
            at_s = self._motion_ends_s = at_s + seconds
        elif name == "movel":
            self._arm.frames(self._tool, IDENTITY)
            try:
                at_s = self._motion_ends_s = self._arm.line(
                    compose(self._base, _pose(words)), self._speed(words, at_s), at_s
                )
            except HaltError:
                self.safety_bits = PROTECTIVE_STOP
        return at_s

    def _speed(self, words: str, at_s: float) -> tuple[float, float]:
        """Speeds of path and turn that a `movel` asks for, mm/s and deg/s.

        They follow from the statement's duration `t`, if it has one. Otherwise its speed `v` applies to the
        path, and the turn has no limit.
        """
        pacing = dict(re.findall(r"\b([avt])=([\d.]+)", words))
        if "t" not in pacing:
            return 1000.0 * float(pacing["v"]) * self.speed_fraction, math.inf
        here, target = self._tcp_at(at_s), _pose(words)
        seconds = float(pacing["t"]) / self.speed_fraction
        turn_deg = math.degrees(turn_between(here.rotation, target.rotation))
        path_mm = math.dist(here[:3], target[:3])
        return max(path_mm / seconds, 1e-3), max(turn_deg / seconds, 1e-3)


def _parsed(program: str) -> list[tuple[str, str]]:
    """Name and arguments of each statement; empty if the program is malformed or a statement is unknown."""
    lines = [line.strip() for line in program.strip().splitlines()]
    if len(lines) < 3 or not re.fullmatch(r"def \w+\(\):", lines[0]) or lines[-1] != "end":
        return []
    results = [STATEMENT.fullmatch(line) for line in lines[1:-1]]
    known = {"set_tcp", "movel", "stopl", "write_output_integer_register"}
    matches = [(match[1], match[2]) for match in results if match is not None and match[1] in known]
    return matches if len(matches) == len(results) else []


def _pose(words: str) -> Pose:
    match = POSE.search(words)
    numbers = tuple(float(word) for word in match[1].split(",")) if match else ()
    return script.frame(numbers)


def _vector(pose: Pose) -> tuple[float, ...]:
    return (*(value / 1000.0 for value in pose[:3]), *script.rotation_vector(pose.rotation))
