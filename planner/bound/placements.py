"""The placements that a certificate covers: what a plan of the job may choose from, and the plan's own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Metric, metric_of
from planner.belief.particles import initial, subsample
from planner.bound.histories import READINGS
from planner.evaluation.trials import placement_of
from planner.frames import to_hand
from planner.job.model import Job
from planner.part.outline import radius_of_gyration
from planner.search.actions import ActionSet, actions_of
from planner.search.proposals import along
from runtime.table import REJECT, Calibration, Table, decision_map

BELIEF = 400
"""Parts of a history that its modes are sought among."""
DENSE_ANGLES_DEG = np.arange(0.0, 180.0, 15.0)
DENSE_SHIFTS = (-0.5, 0.0, 0.5)
"""Shifts along the fingers, in lengths of the finger."""
ALIKE = 1e-3
"""Placements that differ by less are one [mm, mm, rad]."""

Key: TypeAlias = tuple[tuple[int, ...], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Covered:
    """The placements of a class of plans; called as `planner.bound.histories.Placements`.

    Attributes:
        actions: those of the job, and those proposed about what is believed.
        metric: finds the modes to propose about.
        more: (k, 3) further ones, for every squeeze.
        first: (k, 3) those of the first squeeze, one of each set of equivalent ones.
        own: what the plan itself does second, by the reading; NaN where it ends.
    """

    actions: ActionSet
    metric: Metric
    more: Array
    first: Array
    own: Array

    def __call__(self, squeezes: int, reading: int, parts: Array) -> Array:
        """The placements (k, 3) of the next squeeze: after how many, the last reading, the parts (n, 3)."""
        if squeezes == 0:
            return self.first
        options = [self.actions.options(subsample(parts, BELIEF), self.metric), self.more]
        if squeezes == 1 and np.isfinite(self.own[reading]).all():
            options.append(self.own[reading][None])
        return np.concatenate(options)


def covered(job: Job, table: Table, dense: bool) -> Covered:
    """The placements for a table's job.

    Args:
        job: the table's.
        table: of which the first two squeezes are covered whatever the job says.
        dense: whether a grid of placements about the middle is covered, too.
    """
    actions, metric = actions_of(job), metric_of(job, radius_of_gyration(job.part.outline_mm))
    more = _dense(job) if dense else np.zeros((0, 3))
    own = np.full((READINGS, 3), np.nan)
    calibration = Calibration.linear(table.gripper)
    for reading, branch in enumerate(decision_map(table.nodes[0], calibration)):
        target = -1 if branch == REJECT else table.nodes[0].branches[branch].target
        if target >= 0:
            own[reading] = placement_of(table.nodes[target].squeeze)
    parts = initial(job, BELIEF, np.random.default_rng(job.seed))
    common = np.concatenate([actions.options(parts, metric), more])
    root = placement_of(table.nodes[0].squeeze)
    first = _inequivalent(np.concatenate([root[None], common]), common, job)
    return Covered(actions, metric, more, first, own)


def _dense(job: Job) -> Array:
    """Every 15 degrees, over the middle and to either side of it."""
    length = job.gripper.finger_length_mm
    middle = np.array([[0.0, 0.0, math.radians(angle)] for angle in DENSE_ANGLES_DEG])
    return np.concatenate([along(middle, share * length) for share in DENSE_SHIFTS])


def _inequivalent(placements: Array, common: Array, job: Job) -> Array:
    """Of first placements (k, 3) those that no turn about the origin makes one before them.

    Where parts lie in a disc about the origin at any angle, a turn of the whole plan changes nothing. It must
    carry the placements (m, 3) common to all squeezes onto themselves; those about modes turn with the parts.
    """
    unknown = math.isclose(job.uncertainty.orientation_halfwidth_deg, 180.0)
    alike = job.gripper.upper_finger_share == 0.5  # then half a turn of the hand changes nothing either
    seen: dict[tuple[Key, Key], Array] = {}
    for placement in placements:
        turns = [placement[2], placement[2] + math.pi] if unknown else [0.0]
        keys = [
            (_key(_turned(placement[None], turn), alike), _key(_turned(common, turn), alike))
            for turn in turns
        ]
        if not any(key in seen for key in keys):
            seen[keys[0]] = placement
    return np.array(list(seen.values()))


def _turned(placements: Array, turn: float) -> Array:
    """Placements (k, 3) in a world turned back by an angle."""
    return to_hand(placements, np.array([0.0, 0.0, turn]))


def _key(placements: Array, alike: bool) -> Key:
    """A set of placements (k, 3), equal for equal sets."""
    period = math.pi if alike else 2.0 * math.pi
    angle = np.round(np.mod(placements[:, 2] + 0.5 * ALIKE, period) / ALIKE - 0.5)
    rows = np.column_stack([np.round(placements[:, :2] / ALIKE), angle]).astype(np.int64)
    return tuple(sorted({tuple(row) for row in rows.tolist()}))
