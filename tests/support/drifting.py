"""Simulates parts of a healthy or drifting cell in the contact world, as journals would record them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import evaluate
from planner.evaluation.judge import metric_of_table
from planner.evaluation.outcome import Evaluation
from planner.evaluation.trials import encoder_of_table
from planner.frames import wrap
from planner.job.model import Job
from planner.work.scheduler import Threads
from planner.world import supply
from runtime.shell.worlds import DEFAULT_WORLD
from runtime.spc.history import NodeReading, Part
from runtime.table import REJECT, Table, predicted_pose

SEEN_SIGMA = (0.05, 0.05, 0.002)  # standard deviations of the camera's poses: mm, mm, rad


class Drift(NamedTuple):
    """How a drifting cell differs from the planned one.

    Attributes:
        friction: least and greatest friction between finger and part; None: as planned.
        width_mm: offset that is added to every width.
        seen_off: offset that is added to every pose that the camera measures: mm, mm, rad.
    """

    friction: tuple[float, float] | None = None
    width_mm: float = 0.0
    seen_off: tuple[float, float, float] = (0.0, 0.0, 0.0)


HEALTHY = Drift()


def squeezed(table: Table, job: Job, count: int, seed: int, drift: Drift = HEALTHY) -> Evaluation:
    """Evaluates the table: sends `count` simulated parts through it, in a cell with this drift."""
    world_job = job
    if drift.friction is not None:
        low, high = drift.friction
        world_job = job.replaced(friction={"finger_part_min": low, "finger_part_max": high})
    world = supply(DEFAULT_WORLD, world_job, seed)
    disturbance = Disturbance(encoder_offset_mm=drift.width_mm)
    return evaluate(table, world_job, world, count, seed, Threads(), disturbance)


def parts(table: Table, result: Evaluation, seed: int, drift: Drift = HEALTHY) -> Iterator[Part]:
    """Yields the parts of an evaluation as journals record them, each with an audit."""
    encoder = encoder_of_table(table)
    noise = np.random.default_rng([seed, 0x5345]).normal(0.0, SEEN_SIGMA, result.poses.shape)
    seen = result.poses + noise + drift.seen_off
    for number, leaf in enumerate(result.leaf):
        taken = []
        rows = result.path[number], encoder.width_um(result.steps[number]), result.branch[number]
        for node, width_um, branch in zip(*rows, strict=True):
            if node >= 0:
                taken_by = None if branch == REJECT else int(branch)
                taken.append(NodeReading(int(node), taken_by, int(width_um)))
        yield _part(table, number, tuple(taken), int(leaf), seen[number])


def _part(
    table: Table, number: int, taken: tuple[NodeReading, ...], end: int, seen: NDArray[np.float64]
) -> Part:
    if end < 0:
        return Part(number, taken, "reject")
    leaf = table.leaves[end]
    predicted = np.array(predicted_pose(leaf))
    off = seen - predicted
    turn = float(wrap(np.array([off[2]]), table.goal.symmetry)[0])
    verdict = "pass" if bool(metric_of_table(table).reached(seen, predicted)) else "fail"
    outcome = "leaf" if leaf.resolved else "unresolved"
    return Part(number, taken, outcome, end, verdict, (float(off[0]), float(off[1]), turn))
