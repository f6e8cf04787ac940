"""Whether a leaf is right about a part: the one place that knows the kinds of goals a table may state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.frames import wrap
from planner.goal import Metric
from runtime.table import GoalSpec, Leaf, Table


class Verdict(NamedTuple):
    """How n parts lie to what their leaves say.

    Attributes:
        error_mm: (n,) audit metric, to the nearest of the leaf's poses; infinite without a leaf.
        within: (n,) whether that is within the goal.
    """

    error_mm: Array
    within: BoolArray


def metric_of_table(table: Table) -> Metric:
    """The audit metric that the table states (paper eq. 9)."""
    goal = table.goal
    return Metric(goal.distance_um / 1e3, goal.rho_um / 1e3, goal.symmetry)


def poses_of(leaf: Leaf, goal: GoalSpec) -> Array:
    """The poses (m, 3) any of which makes a leaf right: several only where the goal asks for modes."""
    rows = [(leaf.x_um, leaf.y_um, leaf.theta_urad)]
    if goal.kind == "modes":
        rows += leaf.alternatives
    return np.asarray(np.array(rows) / np.array([1e3, 1e3, 1e6]))


def judge(table: Table, leaf: IntArray, poses: Array) -> Verdict:
    """Holds true poses against what the leaves say.

    Args:
        table: the table.
        leaf: (n,) the leaf each part ended in, negative for none.
        poses: (n, 3) where it truly lies [mm, mm, rad].
    """
    metric = metric_of_table(table)
    error = np.full(len(leaf), np.inf)
    within = np.zeros(len(leaf), np.bool_)
    for index in np.unique(leaf[leaf >= 0]):
        here = leaf == index
        offset = poses[here][:, None] - poses_of(table.leaves[index], table.goal)[None]
        offset[..., 2] = wrap(offset[..., 2], table.goal.symmetry)
        distance = metric.between(offset, np.zeros(3))
        error[here] = distance.min(axis=1)
        within[here] = _within(offset, distance, table.goal).any(axis=1)
    return Verdict(error, within)


def _within(offset: Array, distance: Array, goal: GoalSpec) -> BoolArray:
    """Where offsets (..., 3), turns reduced by the symmetry, and their metric (...) are within the goal."""
    tolerance = np.array(goal.tolerance) / np.array([1e3, 1e3, 1e6])
    if goal.kind == "tolerances":
        return np.asarray((np.abs(offset) <= tolerance).all(axis=-1))
    if goal.kind == "orientation":
        return np.asarray(np.abs(offset[..., 2]) <= tolerance[2])
    return np.asarray(distance < goal.distance_um / 1e3)
