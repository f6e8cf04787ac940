"""A gripper and an arm of a make that does not exist: what one new file looks like, and their devices.

Both speak lines of text over TCP, in millimetres. The drivers are the first half of this file; they import
nothing of the Robotiq or ABB packages. The devices, for the contract tests, are the second half.
"""

import math
import socketserver
import threading
import time

from drivers.clock import Pace
from drivers.errors import ArmError, GripperFault, LinkError, LinkTimeout, ReadOnlyError
from drivers.ports import GripperState, Settled
from drivers.stream import Stream, open_tcp

ANSWER_S = 0.5
STROKE_MM = 60.0

# -- the drivers ----------------------------------------------------------------------------------


QUESTIONS = ("status", "where")


class Lines:
    """One line out, one line back; `read_only`: no line that is not a question goes out."""

    def __init__(self, stream: Stream, pace: Pace, *, read_only: bool = False) -> None:
        self.endpoint, self._stream, self._pace = stream.endpoint, stream, pace
        self._lost, self._read_only = "", read_only

    def ask(self, line: str, seconds: float = ANSWER_S) -> list[str]:
        if self._lost:
            raise LinkError(f"{self.endpoint} is closed: {self._lost}")
        if self._read_only and line not in QUESTIONS:
            raise ReadOnlyError(f"a dry run was about to send {line!r} to {self.endpoint}")
        try:
            self._stream.send(line.encode() + b"\n")
            text, deadline = b"", self._pace.deadline(seconds)
            while not text.endswith(b"\n"):
                if (left := deadline - self._pace.now()) <= 0.0:
                    self._lost = "an answer is missing"
                    raise LinkTimeout(f"{self.endpoint} did not answer {line!r}; check its power")
                text += self._stream.receive(left)
        except TimeoutError:
            raise
        except OSError as error:
            self._lost = "the connection broke"
            raise LinkError(f"{self.endpoint} broke; check the cable") from error
        return text.decode().split()

    def close(self) -> None:
        self._lost = self._lost or "it was closed"
        self._stream.close()


class OtherGripper:
    """Counts of 0 to 255 are openings of 60 to 0 mm here."""

    def __init__(self, lines: Lines, pace: Pace) -> None:
        self._lines, self._pace = lines, pace
        self._asked: tuple[int, float] | None = None
        self.state()

    def state(self) -> GripperState:
        ready, moving, held, asked_mm, at_mm = self._lines.ask("status")
        flag = 0 if moving == "1" else 2 if held == "1" else 3
        return GripperState(ready == "1", moving == "1", 0, flag, _counts(asked_mm), _counts(at_mm), 0)

    def activate(self) -> None:
        if self.state().activated:
            return
        self._lines.ask("home")
        deadline = self._pace.deadline(5.0)
        while not self.state().activated:
            self._wait(deadline, "homing")

    def move(self, position_counts: int, speed_counts: int, force_counts: int) -> None:
        self._asked = None
        if not self.state().activated:
            raise GripperFault("gripper not active; home it first")
        opening_mm = STROKE_MM * (255 - position_counts) / 255
        self._lines.ask(f"go {opening_mm:.3f} {10 + speed_counts} {force_counts}")
        self._asked = position_counts, self._pace.now()

    def wait(self) -> Settled:
        if self._asked is None:
            raise GripperFault("no move to wait for; call move() first")
        (asked, since), self._asked = self._asked, None
        deadline = self._pace.deadline(10.0)
        while (seen := self.state()).moving:
            self._wait(deadline, "moving")
        if seen.echo_counts != asked or not seen.activated:
            raise GripperFault("the gripper forgot the move; was its power cut?")
        return Settled(seen.position_counts, seen.object_flag, 0, asked, self._pace.elapsed(since))

    def stop(self) -> None:
        self._lines.ask("stop")

    def close(self) -> None:
        self._lines.close()

    def _wait(self, deadline: float, doing: str) -> None:
        if self._pace.now() > deadline:
            raise GripperFault(f"gripper not done {doing} in time")
        self._pace.idle(deadline)


def _counts(millimetres: str) -> int:
    return round(255 - float(millimetres) * 255 / STROKE_MM)


def gripper(port: str, pace: Pace, report: object, *, read_only: bool) -> OtherGripper:
    host, _, number = port.removeprefix("other://").partition(":")
    stream = open_tcp(host, int(number), port, "check its power")
    return OtherGripper(Lines(stream, pace, read_only=read_only), pace)


class OtherArm:
    """Refuses what it cannot reach; after a missing answer its state is unknown."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines

    def pose(self) -> tuple[float, float, float, float]:
        x, y, z, angle = map(float, self._ask("where"))
        return x, y, z, angle

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        return -math.inf, math.inf

    def obstacle(self, start: tuple[float, ...], target: tuple[float, ...]) -> str:
        return ""

    def move_linear(self, x_mm: float, y_mm: float, z_mm: float, angle_rad: float, speed_mm_s: float) -> None:
        target = (x_mm, y_mm, z_mm, angle_rad)
        if not all(map(math.isfinite, (*target, speed_mm_s))) or not speed_mm_s > 0.0 or max(target) > 1e3:
            raise ArmError(f"arm not moved: {target} at {speed_mm_s} mm/s cannot be sent")
        path_s = math.dist(target[:3], self.pose()[:3]) / speed_mm_s
        if self._ask(f"move {x_mm} {y_mm} {z_mm} {angle_rad} {speed_mm_s}", 2.0 * path_s + 1.0) != ["ok"]:
            raise ArmError(f"arm not moved: {target} is out of its reach")

    def close(self) -> None:
        self._lines.close()

    def _ask(self, line: str, seconds: float = ANSWER_S) -> list[str]:
        try:
            return self._lines.ask(line, seconds)
        except LinkError as error:
            raise ArmError(f"arm lost, state unknown since {error}") from error


def arm(host: str, number: int, pace: Pace, setup) -> OtherArm:
    stream = open_tcp(host, number, f"other://{host}:{number}", "check its power")
    return OtherArm(Lines(stream, pace, read_only=setup.read_only))


# -- the devices ----------------------------------------------------------------------------------


class Server:
    """Answers lines on a TCP port; `answer` returns a line, or None for silence."""

    def __init__(self, answer) -> None:
        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                for line in self.rfile:
                    if (said := answer(line.decode().split())) is not None:
                        self.wfile.write(said.encode() + b"\n")

        class Threaded(socketserver.ThreadingTCPServer):
            daemon_threads = True
            block_on_close = False

        self._server = Threaded(("127.0.0.1", 0), Handler)
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


class GripperDevice:
    """Moves at the speed it is told, stops at whatever `contact_mm` says."""

    def __init__(self, scale: float) -> None:
        self.scale, self.contact_mm, self.mute = scale, None, False
        self.commands = 0
        self.asked = self.start = self.stop_mm = STROKE_MM
        self.since, self.speed = 0.0, 1.0
        self.ready = self.held = False

    def answer(self, words):
        if self.mute:
            return None
        if words[0] == "status":
            moving = self.at() != self.stop_mm
            held = self.held and not moving
            return f"{self.ready:d} {moving:d} {held:d} {self.asked:.3f} {self.at():.3f}"
        self.commands += 1
        if words[0] == "home":
            self.ready = True
        elif words[0] == "go" and self.ready:
            self.start, self.asked, self.speed = self.at(), float(words[1]), float(words[2])
            blocked = self.contact_mm is not None and self.asked <= self.contact_mm < self.start + 1e-6
            self.held, self.stop_mm = blocked, self.contact_mm if blocked else self.asked
            self.since = time.monotonic()
        elif words[0] == "stop":
            self.start = self.stop_mm = self.at()
        return "ok"

    def at(self) -> float:
        way = self.speed * (time.monotonic() - self.since) * self.scale
        left = self.stop_mm - self.start
        return self.stop_mm if abs(left) <= way else self.start + math.copysign(way, left)


class ArmDevice:
    """Answers when it stands; silent when `mute`."""

    def __init__(self, scale: float) -> None:
        self.scale, self.mute, self.moves = scale, False, 0
        self.place = (0.0, 0.0, 100.0, 0.0)

    def answer(self, words):
        if self.mute:
            return None
        if words[0] == "where":
            return " ".join(f"{value:.3f}" for value in self.place)
        x, y, z, angle, speed = map(float, words[1:])
        if math.hypot(x, y) > 250.0:
            return "no"
        time.sleep(math.dist(self.place[:3], (x, y, z)) / speed / self.scale)
        self.place, self.moves = (x, y, z, math.remainder(angle, math.tau)), self.moves + 1
        return "ok"
