"""Displaces the arm while it stands: above the tolerance, a displacement has to end the part in a fault.

Every part runs twice with the same seed. The first run is undisturbed and shows when the arm rests at the
part. In the second run the arm is displaced at a random moment of one of these rests. Every tenth
displacement is below the tolerance, and must not cause a fault of the arm.
"""

import math
import random
from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

from fake_cell import FakeJournal

from drivers.sim.physics.scene import Setting
from drivers.sim.virtual.cell import VirtualCell
from runtime.execution.events import Console
from runtime.execution.executor import Cell, Executor, RunOptions
from runtime.execution.handling import Handling
from runtime.execution.safety import PLACED_MM, PLACED_RAD
from runtime.shell.exit_codes import ExitCode
from runtime.table import Table
from runtime.traversal.results import PartResult

READ = "3 "  # start of the instruction that reads the arm's pose
# Rests up to SHORT_S are left out, since no jaws move in them. EDGE_S separates readings and displacements.
SHORT_S, EDGE_S = 0.02, 0.005
BELOW, ABOVE = 0.8, 1.2  # shares of the tolerance: poses are read to 0.01 mm and about 1 mrad
MOST_MM, MOST_RAD = 12.0, math.pi
EVERY = 10
HANDLED = (RunOptions(), RunOptions(handling=Handling(regulated=True)))


class Displacement(NamedTuple):
    """A displacement of the hand, and the time at which it happens."""

    moment_s: float
    by: tuple[float, float, float, float]  # mm, mm, mm, rad

    @property
    def above(self) -> bool:
        """Whether the displacement is above the tolerance."""
        return math.hypot(*self.by[:3]) > PLACED_MM or abs(self.by[3]) > PLACED_RAD


class Run(NamedTuple):
    """How one part was run: the result, the rests of the arm, and whether the arm was displaced."""

    result: PartResult
    rests: list[tuple[float, float]]  # start and end of each rest in which the jaws may move [s]
    met: bool  # whether the arm was displaced


def campaign(
    setting: Setting, table: Table, numbers: range, seed: int, report: Callable = print
) -> Counter[str]:
    """Displaces the arm once during each part of `numbers`; returns how many parts ended in each way."""
    ends: Counter[str] = Counter()
    for number in numbers:
        draw = random.Random(f"{seed}/{number}")
        options = draw.choice(HANDLED)
        sound = run_part(setting, table, options, number, None)
        case = drawn(draw, sound.rests, above=number % EVERY != 0)
        ended = run_part(setting, table, options, number, case)
        end = _judged(sound, ended, case)
        ends[end] += 1
        if end.startswith("FAILED"):
            report(f"{end}: number {number}, {case}: {ended.result}")
    return ends


def run_part(
    setting: Setting, table: Table, options: RunOptions, seed: int, case: Displacement | None
) -> Run:
    """Runs the first part of a new cell, and displaces the arm meanwhile, unless `case` is None."""
    heard: list[tuple[float, str]] = []
    cell = VirtualCell(setting, seed, None, lambda text: heard.append((cell.clock.now(), text)))
    gripper = cell.gripper()
    gripper.activate()
    arm = cell.arm()
    cell.scene.next_part()
    moved: list[bool] = []
    if case is not None:
        cell.clock.at(case.moment_s, lambda: moved.append(_displace(cell, case)))
    begun = len(heard)
    executor = Executor(table, Cell(gripper, arm, cell.clock, FakeJournal()), Console(), options)
    result = executor.run_part(1)
    rests = [
        (start_s, end_s)
        for (start_s, first), (end_s, second) in pairwise(heard[begun:])
        if first.startswith(READ) and second.startswith(READ) and end_s - start_s > SHORT_S
    ]
    return Run(result, rests, any(moved))


def drawn(draw: random.Random, rests: list[tuple[float, float]], *, above: bool) -> Displacement:
    """Draws a displacement of the hand's position, its angle or both, at a time within one of the rests.

    The rests are (start, end) [s]; `above` asks for a displacement above the tolerance.
    """
    (start_s, end_s) = draw.choices(rests, [end - start for start, end in rests])[0]
    moment_s = draw.uniform(start_s + EDGE_S, end_s - EDGE_S)
    if not above:
        by = _by(draw, BELOW * PLACED_MM * draw.random(), BELOW * PLACED_RAD)
        return Displacement(moment_s, by)
    far_mm, turn_rad = (
        math.exp(draw.uniform(math.log(ABOVE * least), math.log(most)))
        for least, most in ((PLACED_MM, MOST_MM), (PLACED_RAD, MOST_RAD))
    )
    which = draw.choice(("place", "turn", "both"))
    by = _by(draw, 0.0 if which == "turn" else far_mm, 0.0 if which == "place" else turn_rad)
    return Displacement(moment_s, by)


def _by(draw: random.Random, far_mm: float, turn_rad: float) -> tuple[float, float, float, float]:
    bearing, rise = draw.uniform(-math.pi, math.pi), math.asin(draw.uniform(0.0, 1.0))
    level_mm = far_mm * math.cos(rise)
    turn = draw.choice((-turn_rad, turn_rad))
    return level_mm * math.cos(bearing), level_mm * math.sin(bearing), far_mm * math.sin(rise), turn


def _displace(cell: VirtualCell, case: Displacement) -> bool:
    moved = cell.works.arm.displace(case.by, cell.clock.now())
    cell.works.arm_stands()
    return moved


def _judged(sound: Run, ended: Run, case: Displacement) -> str:
    before, after = sound.result, ended.result
    if not ended.met:
        return "out of the arm's reach"
    if not case.above:
        same = (before.outcome, before.exit_code) == (after.outcome, after.exit_code)
        if same or not _of_arm(after):
            return "below the tolerance: no fault"
        return "FAILED below the tolerance: a fault"
    if _of_arm(after) and after.leaf is None and after.safe_state:
        return "above the tolerance: a fault"
    return "FAILED above the tolerance: no fault of the arm"


def _of_arm(result: PartResult) -> bool:
    """Whether a part ended with a fault of the arm."""
    reason = result.reason or ""
    return result.exit_code == ExitCode.DEVICE and "the arm" in reason
