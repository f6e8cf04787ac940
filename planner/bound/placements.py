"""The placements that a certificate covers: what a plan of the job may choose from, and the plan's own."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.belief.metric import metric_of
from planner.belief.particles import initial, subsample
from planner.bound.histories import Model
from planner.evaluation.trials import placement_of
from planner.job.model import Job
from planner.search.actions import actions_of, inequivalent
from planner.search.proposals import along
from runtime.table import REJECT, Calibration, Table, decision_map

PILOTS = 10_000  # parts that show what may be read after the first squeeze
BELIEF = 400  # parts of a history that its modes are sought among
DENSE_ANGLES_DEG = np.arange(0.0, 180.0, 15.0)
DENSE_SHIFTS = (-0.5, 0.0, 0.5)  # shifts along the fingers, in lengths of the finger


@dataclass(frozen=True, slots=True, eq=False)
class Covered:
    """The placements of a class of plans; called as `planner.bound.histories.Placements`."""

    first: Array  # (k, 3) those of the first squeeze: the plan's own at the start, none equivalent to another
    second: list[dict[int, Array]]  # for each of these, those (m, 3) of the second squeeze by what was read
    common: Array  # (m, 3) those after a reading that is not among them

    def __call__(self, squeezes: int, option: int, reading: int) -> Array:
        """The placements (k, 3) of the next squeeze."""
        return self.second[option].get(reading, self.common) if squeezes else self.first


def covered(job: Job, table: Table, model: Model, dense: bool, rng: np.random.Generator) -> Covered:
    """The placements for a table's job.

    Those proposed about modes are found with parts of their own: a certificate must not choose what it covers
    by the sample that it judges with.

    Args:
        job: the table's.
        table: of which the first two squeezes are covered whatever the job says.
        model: squeezes these parts.
        dense: whether a grid of placements about the middle is covered, too.
        rng: of these parts.
    """
    actions, metric = actions_of(job), metric_of(job)
    parts, more = initial(job, PILOTS, rng), _dense(job) if dense else np.zeros((0, 3))
    common = np.concatenate([actions.placements, more])
    root = placement_of(table.nodes[0].squeeze)
    first = inequivalent(np.concatenate([root[None], common]), common, job)
    second: list[dict[int, Array]] = []
    for placement in first:
        after, readings = model.squeeze(parts, np.tile(placement, (len(parts), 1)), 1, rng)
        about: dict[int, Array] = {}
        for reading in np.unique(readings):
            belief = subsample(after[readings[0] == reading], BELIEF)
            about[int(reading)] = np.concatenate([actions.options(belief, metric), more])
        second.append(about)
    for reading, own in _next_of(table):
        second[0][reading] = np.concatenate([second[0].get(reading, common), own[None]])
    return Covered(first, second, common)


def _next_of(table: Table) -> Iterator[tuple[int, Array]]:
    """Where a table squeezes second, after each reading that it squeezes again after."""
    root = table.nodes[0]
    for reading, branch in enumerate(decision_map(root, Calibration.linear(table.gripper))):
        if branch != REJECT and root.branches[branch].target >= 0:
            yield reading, placement_of(table.nodes[root.branches[branch].target].squeeze)


def _dense(job: Job) -> Array:
    """Every 15 degrees, over the middle and to either side of it."""
    length = job.gripper.finger_length_mm
    middle = np.array([[0.0, 0.0, math.radians(angle)] for angle in DENSE_ANGLES_DEG])
    return np.concatenate([along(middle, share * length) for share in DENSE_SHIFTS])
