"""A cell in memory whose controlling process can be killed at any frame, arm command or journal write.

The real driver exchanges register blocks with the simulated gripper. The arm finishes each motion even if the
process that commanded the motion is killed, as a real controller does. The world knows where the part lies,
and lists each forbidden event that occurs, such as a lift of the part.
"""

import hashlib
import os
import random
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import hypot, inf, remainder, tau
from pathlib import Path
from unittest.mock import patch

from drivers.clock import Pace
from drivers.ports import TURN_RADIUS_MM, PoseOfHand
from drivers.robotiq.gripper import Gripper
from drivers.sim.devices.gripper import GripperModel
from drivers.sim.virtual.clock import VirtualClock
from runtime.execution import crash, session
from runtime.execution.events import Console
from runtime.execution.executor import Cell, RunOptions
from runtime.journal import chain as journal
from runtime.journal.chain import Journal
from runtime.table import Calibration, Node, Pose2, Table, dumps
from runtime.table.geometry import end_of, placement

REACH_MM = 35.0
RESUME_WITHIN_S = 60.0
LOOK_S = 0.04
RESTART_S = 3.0
NEAR_MM, NEAR_RAD = 0.3, 0.01
FREE_MM = 1.5


class KilledError(BaseException):
    """Raised where the process is killed; a BaseException, so that no handler of the process catches it."""


class Life:
    """Counts the moments at which a process may be killed, and kills it at the moment with number `last`."""

    def __init__(self, last: int | None) -> None:
        self.last, self.moment = last, 0

    def moment_passes(self) -> None:
        if self.last is not None and self.moment >= self.last:
            raise KilledError
        self.moment += 1

    @contextmanager
    def moments(self) -> Iterator[None]:
        """Context with two moments at which the process may be killed: one before its body, one after it."""
        self.moment_passes()
        yield
        self.moment_passes()


class Time(VirtualClock):
    """A virtual clock: idling takes the requested time, but ends at the deadline."""

    def idle(self, seconds: float, until: float) -> None:
        self.sleep(min(seconds, until - self.now()))

    def uptime(self) -> Mapping[str, object]:
        return {"boot": "a boot", "up_s": self.now()}


class World:
    """Part, gripper and arm controller: everything that survives the death of the process.

    The part follows `path` through the table. While the part lies where the path expects it, squeezes read
    the widths of the path; elsewhere they read a width that no branch has. `wrongs` lists each forbidden
    event that occurs, such as a lift of the part.
    """

    def __init__(self, table: Table, path: list[tuple[int, int]]) -> None:
        self.time = Time()
        self.calibration = Calibration(table.gripper.profile)
        self.table = table
        self.path = path  # (node, branch), from the root to a leaf
        pushes = [push for node in table.nodes for push in node.pushes]
        self._ways = [(placement(push), end_of(push)) for push in pushes]
        self.at_mm = (5.0, 5.0, 60.0, 0.1)
        self.wrongs: list[str] = []
        self.squeezed: list[int] = []
        self._lies_mm = self._expected(0)
        self._grip_mm: float | None = None
        self.model = GripperModel(random.Random(1), self, table.gripper.profile)
        self.model.write_output(0, bytes([1, 0, 0, 0, 0, 0]), 0.0)
        self.time.advance(20.0)
        self.model.advance(self.time.now())  # the gripper is active now

    # Called by the simulated gripper.

    def closing(self) -> float | None:
        if self.at_mm[2] > REACH_MM:
            return None
        for index, (number, branch) in enumerate(self.path):
            node = self.table.nodes[number]
            if self._stands_at(node) and self._lies_at(index):
                self.squeezed.append(number)
                return node.branches[branch].expected_um / 1000
        return self.table.gripper.opening_um / 2000

    def gripped(self) -> None:
        self._grip_mm = self.model.opening_mm(self.time.now())

    def released(self) -> None:
        """Does nothing: `_let_go` checks the opening of the jaws whenever the arm moves."""

    def _let_go(self) -> None:
        opening_mm = self.model.opening_mm(self.time.now())
        if self._grip_mm is not None and opening_mm > self._grip_mm + FREE_MM:
            self._grip_mm = None

    # Called by the arm.

    def move(self, target: tuple[float, float, float, float]) -> None:
        self._let_go()
        across = (target[0] - self.at_mm[0], target[1] - self.at_mm[1])
        aside = hypot(*across) > NEAR_MM
        pushes = any(_near(self.at_mm, start) and _near(target, end) for start, end in self._ways)
        if self._grip_mm is not None:
            if target[2] > REACH_MM:
                self.wrongs.append(f"the part was lifted to {target}")
            if aside:
                self._lies_mm = (self._lies_mm[0] + across[0], self._lies_mm[1] + across[1])
        elif aside and min(target[2], self.at_mm[2]) <= REACH_MM and not pushes:
            self.wrongs.append(f"the hand swept over the table from {self.at_mm} to {target}")
        beside = any(_near(target, start) for start, _ in self._ways)
        opening_mm = self.model.opening_mm(self.time.now())
        if target[2] <= REACH_MM < self.at_mm[2] and opening_mm < 60.0 and not beside:
            self.wrongs.append("the hand came down with closed jaws")
        self.time.sleep(0.2)
        self.at_mm = target

    def _stands_at(self, node: Node) -> bool:
        return _near(self.at_mm, placement(node.squeeze))

    def _lies_at(self, index: int) -> bool:
        x_mm, y_mm = self._expected(index)
        return hypot(x_mm - self._lies_mm[0], y_mm - self._lies_mm[1]) <= NEAR_MM

    def _expected(self, index: int) -> tuple[float, float]:
        """Returns where the part should lie before step `index` of the path [mm], after all earlier drags."""
        place = (0.0, 0.0)
        for number, _ in self.path[:index]:
            node = self.table.nodes[number]
            if node.release is not None:
                x, y, _ = placement(node.squeeze)
                drag_mm = (node.release.x_um / 1000 - x, node.release.y_um / 1000 - y)
                place = (place[0] + drag_mm[0], place[1] + drag_mm[1])
        return place


def _near(at_mm: tuple[float, ...], place: Pose2) -> bool:
    """Whether a hand at `at_mm` stands at a place; the height does not matter."""
    near = hypot(place[0] - at_mm[0], place[1] - at_mm[1]) <= NEAR_MM
    return near and abs(remainder(place[2] - at_mm[3], tau)) <= NEAR_RAD


class CountedLink:
    """A link to the gripper's register blocks; the process may be killed before and after each frame."""

    endpoint = "memory"

    def __init__(self, world: World, life: Life) -> None:
        self._world, self._life = world, life

    def read(self) -> bytes:
        with self._life.moments():
            self._world.time.sleep(LOOK_S)
            return self._world.model.read_input(self._world.time.now())[:6]

    def write(self, block: bytes) -> None:
        with self._life.moments():
            self._world.time.sleep(LOOK_S)
            self._world.model.write_output(0, block, self._world.time.now())

    def close(self) -> None:
        pass


class CountedArm:
    """The arm's driver; the process may be killed before and after it moves the arm or reads its pose."""

    def __init__(self, world: World, life: Life) -> None:
        self._world, self._life = world, life

    def pose(self) -> tuple[float, float, float, float]:
        with self._life.moments():
            return self._world.at_mm

    def turn_range(self, x_mm: float, y_mm: float) -> tuple[float, float]:
        self._life.moment_passes()
        return -inf, inf

    def obstacle(self, start: tuple[float, ...], target: tuple[float, ...]) -> str:
        return ""

    def move_linear(
        self, target: PoseOfHand, speed_mm_s: float, radius_mm: float = TURN_RADIUS_MM
    ) -> None:
        with self._life.moments():
            self._world.move(target)

    def close(self) -> None:
        pass


class CountedJournal(Journal):
    """A journal; the process may be killed before a write, in the middle of it, and after it."""

    def __init__(self, path: Path, world: World, life: Life) -> None:
        self._life = life
        super().__init__(path, world.time.stamp, world.time.uptime)

    def record(self, kind: str, fields: Mapping[str, object]) -> None:
        with self._life.moments(), patch.object(journal, "_write_all", self._torn):
            super().record(kind, fields)

    def _take_back(self) -> None:
        """Does nothing: a killed process cannot remove a record that it has begun to write."""

    def _torn(self, file: int, data: bytes) -> None:
        os.write(file, data[: len(data) // 2])
        self._life.moment_passes()
        os.write(file, data[len(data) // 2 :])


def process(world: World, path: Path, options: RunOptions, *, last=None, after_crash="resume"):
    """Runs the controlling process once, put together as in `runtime.cli`.

    Args:
        world: the cell.
        path: the journal.
        options: options of the run.
        last: number of the moment at which the process is killed; None: never.
        after_crash: what the run does if the journal ends in a crash: "abort", "resume" or "restart".

    Returns:
        The tally of the run, and the number of moments that passed.

    Raises:
        KilledError: the process was killed at moment `last`.
    """
    life = Life(last)
    data = dumps(world.table)
    fields = options.policy.fields()
    with CountedJournal(path, world, life) as journal:
        header = {**fields, "table_sha256": hashlib.sha256(data).hexdigest()}
        begun = crash.look(journal, header, after_crash, Console(), RESUME_WITHIN_S)
        gripper = Gripper(CountedLink(world, life), Pace(world.time))
        crash.begin(journal, begun, data, fields, after_crash)
        cell = Cell(gripper, CountedArm(world, life), world.time, journal)
        tally = session.run_journalled(world.table, cell, Console(), options, begun)
    return tally, life.moment


def restart_takes_a_while(world: World) -> None:
    """Lets the time pass that a restart of the process takes; motions of the gripper end meanwhile."""
    world.time.sleep(RESTART_S)
