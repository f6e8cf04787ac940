"""A simulated UR controller: RTDE as it streams, and the secondary interface as far as our programs go.

The arm's mechanics are those of the simulated ABB arm. A program is a list of `set_tcp`, `movel`, `stopl` and
`write_output_integer_register`; one with anything else is not run, as a syntax error is not. A new one takes
the place of the one that runs.
"""

import math
import re
import socket
import struct
import threading
from collections.abc import Callable

from drivers.abb.codec import IDENTITY, Pose
from drivers.abb.kinematics import compose, turn_between
from drivers.sim.devices.arm import ArmModel, HaltError
from drivers.sim.wire.serving import Lock, SimulatedTime, TcpServer
from drivers.ur import script
from drivers.ur.arm import SCRIPT_PORT_BELOW
from drivers.ur.rtde import FORMATS, HEADER

CONTROLLER_VERSION = (5, 16, 0, 0)
STATEMENT = re.compile(r"(\w+)\((.*)\)")
POSE = re.compile(r"p\[([^\]]*)\]")
NORMAL, PROTECTIVE_STOP = 0b1, 0b100
POWERED, RUNS = 0b1, 0b10
STOPPED, PLAYING, PAUSED = 1, 2, 4  # runtime states
LEAST_HZ, MOST_HZ = 1.0, 500.0
Fields = dict[str, tuple[str, tuple[float, ...]]]


class UrModel:
    """The controller's state.

    Args:
        arm: its mechanics; only this controller moves it.
        base: the arm's base frame in the world, in which programs are written.
        executed: called after each motion that was looked at.
    """

    def __init__(self, arm: ArmModel, base: Pose, executed: Callable[[], None] = lambda: None) -> None:
        self.remote = True  # whether programs are taken from outside
        self.mode, self.safety_bits = 7, NORMAL
        self.speed_fraction = 1.0
        self.registers = dict.fromkeys(range(48), 0)
        self._arm, self._base, self._executed = arm, base, executed
        self._tool = IDENTITY
        self._events: list[
            tuple[float, int, int]
        ] = []  # moment, register, value: what a program has still to do
        self._ends_s = 0.0
        self._motion_ends_s = 0.0
        self._motion = ""  # arguments of the `movel` that was begun last
        self._paused = False
        self._held_s: float | None = None  # since when the program does not go on

    def take(self, program: str, now_s: float) -> None:
        """A program arrives on the secondary interface."""
        statements = _parsed(program)
        if not (self.remote and statements and self.safety_bits == NORMAL and self.mode == 7):
            return
        self.advance(now_s)
        self._halt(now_s)
        self._paused, self._held_s = False, None
        at_s = now_s
        for name, words in statements:
            at_s = self._run(name, words, at_s)
            if self.safety_bits != NORMAL:
                break
        self._ends_s = at_s

    def advance(self, now_s: float) -> None:
        """Let time pass."""
        if self._held_s is not None:
            return
        while self._events and self._events[0][0] <= now_s:
            _, register, value = self._events.pop(0)
            self.registers[register] = value
        if self._motion_ends_s <= now_s:
            self._executed()

    def pause(self, now_s: float) -> None:
        """Somebody pauses the program on the pendant."""
        self._hold(now_s)
        self._paused = True

    def play(self, now_s: float) -> None:
        """And lets it go on."""
        self._paused = False
        self._go_on(now_s)

    def slide(self, fraction: float, now_s: float) -> None:
        """Somebody moves the speed slider; at 0 the program runs, and the arm stands."""
        self._hold(now_s)
        self.speed_fraction = fraction
        self._go_on(now_s)

    def protective_stop(self, now_s: float) -> None:
        """Something was in the way: the program ends, the arm stands."""
        self.advance(now_s)
        self._halt(now_s)
        self.safety_bits = PROTECTIVE_STOP

    def fields(self, now_s: float) -> Fields:
        """All output fields that are offered, with their types."""
        self.advance(now_s)
        pose, soon = self._tcp_at(now_s), self._tcp_at(now_s + 0.002)
        vector, speed = _vector(pose), tuple((b - a) / 2.0 for a, b in zip(pose[:3], soon[:3], strict=True))
        turning = turn_between(pose.rotation, soon.rotation) / 0.002
        runs = self._held_s is not None or now_s < self._ends_s
        bits = POWERED | (RUNS if runs else 0)
        joints = tuple(math.radians(angle) for angle in self._arm.joints_at(now_s))
        fields: Fields = {
            "timestamp": ("DOUBLE", (now_s,)),
            "actual_TCP_pose": ("VECTOR6D", vector),
            "actual_TCP_speed": ("VECTOR6D", (*speed, 0.0, 0.0, turning)),
            "actual_q": ("VECTOR6D", joints),
            "tcp_offset": ("VECTOR6D", _vector(self._tool)),
            "robot_mode": ("INT32", (self.mode,)),
            "robot_status_bits": ("UINT32", (bits,)),
            "safety_status_bits": ("UINT32", (self.safety_bits,)),
            "runtime_state": ("UINT32", (PAUSED if self._paused else PLAYING if runs else STOPPED,)),
            "target_speed_fraction": ("DOUBLE", (self.speed_fraction,)),
        }
        told: Fields = {
            f"output_int_register_{number}": ("INT32", (value,)) for number, value in self.registers.items()
        }
        return fields | told

    def _tcp_at(self, now_s: float) -> Pose:
        """The active tool in the base frame."""
        return compose(self._arm.flange_at(now_s), self._tool)

    def _hold(self, now_s: float) -> None:
        if self._held_s is None:
            self.advance(now_s)
            if now_s < self._ends_s:
                self._held_s = now_s
                self._arm.stop(now_s)

    def _go_on(self, now_s: float) -> None:
        """Go on with what is left of the program, if anything; later by as long as the arm stood."""
        if self._held_s is None or self._paused or self.speed_fraction <= 0.0:
            return
        before_s, later_s = self._motion_ends_s, now_s - self._held_s
        if self._held_s < before_s:
            target = compose(self._base, _pose(self._motion))
            self._motion_ends_s = self._arm.line(target, self._speed(self._motion, now_s), now_s)
            later_s = self._motion_ends_s - before_s
        self._events = [(at_s + later_s, register, value) for at_s, register, value in self._events]
        self._ends_s, self._held_s = self._ends_s + later_s, None

    def _halt(self, now_s: float) -> None:
        self._events.clear()
        self._arm.stop(now_s)
        self._ends_s = self._motion_ends_s = now_s

    def _run(self, name: str, words: str, at_s: float) -> float:
        """One statement; returns when the next one may start."""
        if name == "set_tcp":
            self._tool = _pose(words)
        elif name == "write_output_integer_register":
            register, value = (int(word) for word in words.split(","))
            self._events.append((at_s, register, value))
        elif name == "movel":
            self._arm.frames(self._tool, IDENTITY)
            self._motion = words
            try:
                at_s = self._motion_ends_s = self._arm.line(
                    compose(self._base, _pose(words)), self._speed(words, at_s), at_s
                )
            except HaltError:
                self.safety_bits = PROTECTIVE_STOP
        return at_s

    def _speed(self, words: str, at_s: float) -> tuple[float, float]:
        """What the arm's model calls speed: mm/s and deg/s, the slower of which holds."""
        pacing = dict(re.findall(r"\b([avt])=([\d.]+)", words))
        if "t" not in pacing:
            return 1000.0 * float(pacing["v"]) * self.speed_fraction, math.inf
        here, target = self._tcp_at(at_s), _pose(words)
        seconds = float(pacing["t"]) / self.speed_fraction
        turn_deg = math.degrees(turn_between(here.rotation, target.rotation))
        path_mm = math.dist(here[:3], target[:3])
        return max(path_mm / seconds, 1e-3), max(turn_deg / seconds, 1e-3)


def served(
    model: UrModel, lock: Lock, time: SimulatedTime, host: str = "127.0.0.1"
) -> tuple["SecondaryPort", "RtdePort"]:
    """Both ports of a controller, the secondary interface two below RTDE."""
    while True:
        script_port = SecondaryPort(model, lock, time, (host, 0))
        try:
            return script_port, RtdePort(model, lock, time, (host, script_port.port + SCRIPT_PORT_BELOW))
        except (OSError, OverflowError):  # taken, or beyond the last one
            script_port.close()


class SecondaryPort(TcpServer):
    """Takes programs; tells its clients nothing that they read."""

    def __init__(self, model: UrModel, lock: Lock, time: SimulatedTime, address: tuple[str, int]) -> None:
        super().__init__("ur script", threading.Event(), address)
        self._model, self._lock, self._time = model, lock, time

    def _serve(self, client: socket.socket) -> None:
        text = ""
        for data in self._received(client):
            text += data.decode("latin-1")
            while (end := text.find("\nend\n")) >= 0:
                program, text = text[: end + 5], text[end + 5 :]
                with self._lock:
                    self._model.take(program, self._time.now())


class RtdePort(TcpServer):
    """RTDE version 2 for one client: its outputs; inputs are refused."""

    def __init__(self, model: UrModel, lock: Lock, time: SimulatedTime, address: tuple[str, int]) -> None:
        super().__init__("ur rtde", threading.Event(), address)
        self.mute = False
        self._model, self._lock, self._time = model, lock, time

    def _serve(self, client: socket.socket) -> None:
        session = _Session(self._fields)
        buffer = b""
        while not self._stopped.is_set():
            if self._readable([client], session.wait_s):
                data = client.recv(4096)
                if not data:
                    return
                buffer += data
                while (
                    len(buffer) >= HEADER.size and len(buffer) >= (size := HEADER.unpack_from(buffer)[0]) > 2
                ):
                    package, buffer = buffer[:size], buffer[size:]
                    self._send(client, session.answer(package))
            elif session.started:
                self._send(client, session.data())

    def _send(self, client: socket.socket, data: bytes) -> None:
        if not self.mute:
            client.sendall(data)

    def _fields(self) -> Fields:
        with self._lock:
            return self._model.fields(self._time.now())


class _Session:
    """One client's recipes."""

    def __init__(self, look: Callable[[], Fields]) -> None:
        self.started = False
        self.wait_s = 0.1
        self._look = look
        self._names: list[str] = []
        self._period_s = 0.1

    def answer(self, package: bytes) -> bytes:
        """The reply to one package."""
        kind, payload = chr(package[2]), package[HEADER.size :]
        if kind == "V":
            return _packed(kind, b"\1" if payload == b"\0\2" else b"\0")
        if kind == "v":
            return _packed(kind, struct.pack(">4I", *CONTROLLER_VERSION))
        if kind == "O" and len(payload) > 8:
            rate = min(max(struct.unpack(">d", payload[:8])[0], LEAST_HZ), MOST_HZ)
            # Some clients end the list with a comma.
            self._names = payload[8:].decode("latin-1").rstrip(",").split(",")
            self._period_s = 1.0 / rate
            offered = self._look()
            kinds = [offered[name][0] if name in offered else "NOT_FOUND" for name in self._names]
            self._names = self._names if "NOT_FOUND" not in kinds else []
            return _packed(kind, bytes((bool(self._names),)) + ",".join(kinds).encode())
        if kind == "I":
            return _packed(kind, b"\0" + ",".join("IN_USE" for _ in payload.split(b",")).encode())
        if kind in "SP":
            self.started = kind == "S" and bool(self._names)
            self.wait_s = self._period_s if self.started else 0.1
            return _packed(kind, bytes((kind == "P" or self.started,)))
        return b""

    def data(self) -> bytes:
        """One data package."""
        fields = self._look()
        values = b"".join(
            struct.pack(">" + FORMATS[fields[name][0]], *fields[name][1]) for name in self._names
        )
        return _packed("U", b"\1" + values)


def _packed(kind: str, payload: bytes) -> bytes:
    return HEADER.pack(HEADER.size + len(payload), ord(kind)) + payload


def _parsed(program: str) -> list[tuple[str, str]]:
    """Name and arguments of each statement; none where one is not understood."""
    lines = [line.strip() for line in program.strip().splitlines()]
    if len(lines) < 3 or not re.fullmatch(r"def \w+\(\):", lines[0]) or lines[-1] != "end":
        return []
    found = [STATEMENT.fullmatch(line) for line in lines[1:-1]]
    known = {"set_tcp", "movel", "stopl", "write_output_integer_register"}
    made = [(match[1], match[2]) for match in found if match is not None and match[1] in known]
    return made if len(made) == len(found) else []


def _pose(words: str) -> Pose:
    found = POSE.search(words)
    numbers = tuple(float(word) for word in found[1].split(",")) if found else ()
    return script.frame(numbers)


def _vector(pose: Pose) -> tuple[float, ...]:
    return (*(value / 1000.0 for value in pose[:3]), *script.rotation_vector(pose.rotation))
