"""A cell in memory for tests of the executor: logs every call, reads scripted counts, fails on demand."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from counting import PROFILE, SETTINGS, state

from drivers.ports import TURN_RADIUS_MM, GripperState, PoseOfHand, Settled
from runtime.execution.events import Console
from runtime.execution.executor import Cell


class Deaf(Console):
    """A console that ignores all events."""


class State(NamedTuple):
    """One reading of the fake gripper, in counts."""

    activated: bool = True
    moving: bool = False
    fault: int = 0
    object_flag: int = 3
    echo_counts: int = 0
    position_counts: int = 3
    current_ma: int = 0

    @property
    def reading(self) -> GripperState:
        """The state as a driver reports it."""
        known = {"active": self.activated, "moving": self.moving, "fault": self.fault}
        return state(self.position_counts, self.object_flag, self.echo_counts, **known)


class Call(NamedTuple):
    """One logged call of a method of a fake device."""

    device: str
    name: str
    arguments: tuple[float, ...] = ()


@dataclass
class Log:
    """The calls of all fake devices, in order.

    The call with number `fail_at` raises `error` and has no other effect.
    """

    fail_at: int = -1
    error: BaseException | None = None
    calls: list[Call] = field(default_factory=list)

    def call(self, device: str, name: str, *arguments: float) -> None:
        self.calls.append(Call(device, name, arguments))
        if self.error is not None and len(self.calls) - 1 == self.fail_at:
            raise self.error

    def named(self, name: str) -> list[Call]:
        return [call for call in self.calls if call.name == name]


class FakeGripper:
    """A gripper that closes to the next count and object flag of its script, and opens as commanded.

    Moves are logged in counts.
    """

    profile = PROFILE

    def __init__(self, log: Log, counts: Iterator[tuple[int, int]]) -> None:
        self.log, self.counts = log, counts
        self.now = State()
        self.gripping = False  # a second closing without an opening stops at the same count
        self.current_ma = 300
        self.opened_to = 0  # counts by which an opening falls short of the command
        self.echo_off = 0  # counts by which the settled echo differs from the command

    def state(self) -> GripperState:
        self.log.call("gripper", "state")
        return self.now.reading

    def activate(self) -> None:
        self.log.call("gripper", "activate")
        self.now = self.now._replace(activated=True, fault=0)

    def move(self, width_um: int, speed_mm_s: float, force_n: float) -> None:
        position_counts = SETTINGS.request(width_um)
        settings = SETTINGS.speed(speed_mm_s), SETTINGS.force(force_n)
        self.log.call("gripper", "move", position_counts, *settings)
        count, flag = max(position_counts, 3) + self.opened_to, 3
        if position_counts == 255 and not self.gripping:
            count, flag = next(self.counts)
            self.gripping = True
        elif position_counts == 255:
            count, flag = self.now.position_counts, self.now.object_flag
        else:
            self.gripping = False
        self.now = State(object_flag=flag, echo_counts=position_counts, position_counts=count)

    def wait(self) -> Settled:
        self.log.call("gripper", "wait")
        seen = self.now._replace(echo_counts=self.now.echo_counts + self.echo_off).reading
        return Settled(seen.width_um, seen.object, self.current_ma, seen.target_um, 0.5)

    def stop(self) -> None:
        self.log.call("gripper", "stop")

    def close(self) -> None:
        self.log.call("gripper", "close")


class FakeArm:
    """An arm that reports the target of its last motion as its pose, shifted by `off_mm` along x."""

    def __init__(self, log: Log) -> None:
        self.log = log
        self.at = (5.0, 5.0, 30.0, 0.1)
        self.off_mm = 0.0
        self.radii_mm: list[float] = []  # turn radius of each motion
        self.turns = (-math.inf, math.inf)
        self.obstacles = lambda start, target: ""

    def pose(self) -> tuple[float, float, float, float]:
        self.log.call("arm", "pose")
        return self.at[0] + self.off_mm, *self.at[1:]

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        self.log.call("arm", "turn_range", x_mm, y_mm)
        return self.turns

    def obstacle(self, start: tuple[float, ...], target: tuple[float, ...]) -> str:
        return self.obstacles(start, target)

    def move_linear(
        self, target: PoseOfHand, speed_mm_s: float, radius_mm: float = TURN_RADIUS_MM
    ) -> None:
        self.log.call("arm", "move_linear", *target, speed_mm_s)
        self.radii_mm.append(radius_mm)
        self.at = target

    def close(self) -> None:
        self.log.call("arm", "close")


class FakeJournal:
    """A journal in memory; the record with number `fail_at` raises `error`, and so does every later one."""

    def __init__(self, fail_at: int = -1, error: Exception | None = None) -> None:
        self.kept: list[tuple[str, dict[str, object]]] = []
        self.fail_at, self.error = fail_at, error

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        if self.error is not None and len(self.kept) >= self.fail_at >= 0:
            raise self.error
        self.kept.append((kind, dict(fields)))

    def kinds(self) -> list[str]:
        return [kind for kind, _ in self.kept]


class FakeClock:
    """A clock that advances by `step_s` whenever the time is read, and by the length of each sleep."""

    time = step_s = 0.0

    def now(self) -> float:
        self.time += self.step_s
        return self.time

    def deadline(self, seconds: float) -> float:
        return self.time + seconds

    def sleep(self, seconds: float) -> None:
        self.time += seconds

    def stamp(self) -> str:
        return f"1970-01-01T00:00:{self.time:06.3f}+00:00"


class FakeScene:
    """A scene that counts the parts that are fed, and reports the same truth for each."""

    def __init__(self, truth: object) -> None:
        self.parts, self.known = 0, truth

    def next_part(self) -> int:
        self.parts += 1
        return self.parts

    def truth(self) -> object:
        return self.known

    def close(self) -> None:
        pass


class FakeCell(NamedTuple):
    """A cell of fake devices, together with each of its fakes."""

    log: Log
    gripper: FakeGripper
    arm: FakeArm
    journal: FakeJournal
    cell: Cell


def fake_cell(
    counts: list[tuple[int, int]], log: Log | None = None, journal: FakeJournal | None = None
) -> FakeCell:
    """Returns a fake cell; each closing of the jaws stops at the next (count, object flag) of `counts`."""
    log, journal = log or Log(), journal or FakeJournal()
    gripper, arm = FakeGripper(log, iter(counts)), FakeArm(log)
    return FakeCell(log, gripper, arm, journal, Cell(gripper, arm, FakeClock(), journal))
