"""Judges whether the pose that a leaf states is right for a part, for every kind of goal of a table."""

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.metric import Metric, Mode
from runtime.table import Leaf, Table, hypotheses_of, poses_of

MOST_POSES = 4
LEAST_SHARE = 0.1  # poses with a smaller share of a leaf's parts are scatter


def metric_of_table(table: Table) -> Metric:
    """The metric that measures the distance of two poses for a table's goal, with the goal's tolerance."""
    goal, (x_um, y_um, theta_urad) = table.goal, table.goal.tolerance
    distance_mm, rho_mm = goal.distance_um / 1e3, goal.rho_um / 1e3
    tolerance = (x_um / 1e3, y_um / 1e3, theta_urad / 1e6)
    further = tuple((other.rho_um / 1e3, other.symmetry) for other in table.hypotheses[1:])
    stated = goal.symmetry, goal.kind, tolerance, goal.modes, further, goal.identify
    return Metric(distance_mm, rho_mm, *stated)


def states_of(table: Table, leaf: Leaf) -> Array:
    """All poses (m, 3) that a leaf states; (m, 4) with their hypotheses, if the table has several."""
    poses = np.array(poses_of(table.goal, leaf))
    return np.column_stack([poses, hypotheses_of(table.goal, leaf)]) if table.hypotheses else poses


def main_poses(poses: Array, metric: Metric) -> list[Mode]:
    """The most frequent poses of the parts in one leaf, with their shares, in descending order.

    Returns at most `MOST_POSES` poses, each with `LEAST_SHARE` of the parts or more.

    Args:
        poses: (n, 3 or 4) poses of the parts, n >= 1.
        metric: the metric of the goal, which says what counts as one pose.
    """
    modes = metric.main_modes(poses, MOST_POSES, LEAST_SHARE)
    return [mode for mode in modes if mode.ratio >= LEAST_SHARE]


def errors_mm(table: Table, leaf: IntArray, poses: Array) -> Array:
    """Error (n,) of the leaf of each part: distance from the true pose to the leaf's nearest pose [mm].

    The distance is the audit metric (paper eq. 9).

    Args:
        table: the table.
        leaf: (n,) index of the leaf where each part ended; negative for none, where the error is infinite.
        poses: (n, 3) true poses in the world; a fourth column is the hypothesis, by default the first one.
    """
    # A goal of another kind may state no distance.
    audit = metric_of_table(table)._replace(kind="pose", distance_mm=1.0, identify=False)
    return np.asarray(_distances(table, leaf, poses, audit).min(axis=1))


def within_goal(table: Table, leaf: IntArray, poses: Array) -> BoolArray:
    """Mask (n,) of the parts whose true pose is within the goal of some pose of their leaf.

    See `errors_mm` for the arguments.
    """
    metric = metric_of_table(table)
    return np.asarray((_distances(table, leaf, poses, metric) < metric.goal).any(axis=1))


def _distances(table: Table, leaf: IntArray, poses: Array, metric: Metric) -> Array:
    """Distances (n, m) from each part's true pose to the poses of its leaf; infinite without a leaf.

    A leaf of fewer than m poses repeats its poses.
    """
    answers = [states_of(table, each) for each in table.leaves]
    most = max(map(len, answers))
    said = np.array([np.resize(each, (most, each.shape[1])) for each in answers])
    result, ended = np.full((len(leaf), most), np.inf), leaf >= 0
    result[ended] = metric.between(poses[ended][:, None], said[leaf[ended]])
    return result
