"""When is a part located: the audit metric, and how near a belief is to that (paper VI.1, eq. 9).

The paper averages the poses and counts those near the average; for a belief of two modes the average lies
between them and counts nothing. The *mode ratio* is the largest share of the belief within the goal of one
pose: it grows with progress, and that pose is the right prediction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray
from planner.frames import wrap
from planner.job import Job
from planner.kernel import kernel

CANDIDATES = 48
REFINEMENTS = 4


class Mode(NamedTuple):
    """The pose that explains most of a belief.

    Attributes:
        pose: (3,) [mm, mm, rad].
        ratio: share of the belief within the goal of it.
    """

    pose: Array
    ratio: float


class Metric(NamedTuple):
    """d(q1, q2) = sqrt(dx^2 + dy^2) + rho dtheta, under a rotational symmetry (eq. 9).

    Attributes:
        distance_mm: the goal.
        rho_mm: what one radian weighs.
        order: rotational order of the part.
    """

    distance_mm: float
    rho_mm: float
    order: int

    def between(self, poses: Array, reference: Array) -> Array:
        """Distances of poses (..., 3) to reference poses, broadcast against them [mm]."""
        offset = poses - reference
        turn = np.abs(wrap(offset[..., 2], self.order))
        return np.asarray(np.hypot(offset[..., 0], offset[..., 1]) + self.rho_mm * turn)

    def reached(self, poses: Array, reference: Array) -> BoolArray:
        """Where the distance is below the goal."""
        return np.asarray(self.between(poses, reference) < self.distance_mm)

    def mode(self, poses: Array) -> Mode:
        """The pose with most of the belief within the goal.

        Args:
            poses: (n, 3) particles, n >= 1 [mm, mm, rad].
        """
        pose = np.empty(3)
        ratio = largest_mode(np.ascontiguousarray(poses), self.distance_mm, self.rho_mm, self.order, pose)
        return Mode(pose, float(ratio))


def metric_of(job: Job, rho_mm: float) -> Metric:
    """The metric of a job's goal."""
    return Metric(job.goal.distance_mm, rho_mm, job.part.symmetry)


@kernel
def _inliers(poses: Array, centre: Array, goal: float, rho: float, period: float, mean: Array) -> int:
    """Counts poses within the goal of `centre`; `mean` (3,) receives their mean, taken about it."""
    count = 0
    mean[0] = mean[1] = mean[2] = 0.0
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - centre[0], poses[i, 1] - centre[1]
        turn = poses[i, 2] - centre[2]
        turn -= period * np.round(turn / period)
        if np.sqrt(dx * dx + dy * dy) + rho * abs(turn) < goal:
            count += 1
            mean[0] += dx
            mean[1] += dy
            mean[2] += turn
    for j in range(3):
        mean[j] = centre[j] + mean[j] / max(count, 1)
    return count


@kernel
def largest_mode(poses: Array, goal: float, rho: float, order: int, pose: Array) -> float:
    """Share of the poses within the goal of the best pose found.

    Starts from poses spread evenly through the belief and climbs from the better ones to the mean of what is
    within the goal (mean shift with a flat kernel).

    Args:
        poses: (n, 3), n >= 1 [mm, mm, rad].
        goal: distance [mm].
        rho: what one radian weighs [mm].
        order: rotational order of the part.
        pose: (3,) receives the best pose; modified in place.

    Returns:
        The share, 0 to 1.
    """
    n = poses.shape[0]
    period = 2.0 * np.pi / order
    stride = max(1, n // CANDIDATES)
    centre, mean = np.empty(3), np.empty(3)
    best = -1
    for start in range(0, n, stride):
        for j in range(3):
            centre[j] = poses[start, j]
        count = _inliers(poses, centre, goal, rho, period, mean)
        if 2 * count < best:
            continue
        for _ in range(REFINEMENTS):
            if count > best:
                best = count
                pose[0], pose[1], pose[2] = centre[0], centre[1], centre[2]
            centre[0], centre[1], centre[2] = mean[0], mean[1], mean[2]
            last = count
            count = _inliers(poses, centre, goal, rho, period, mean)
            if count < last:
                break
        if count > best:
            best = count
            pose[0], pose[1], pose[2] = centre[0], centre[1], centre[2]
        if best == n:
            break
    # Among equals the mean is the better prediction.
    _inliers(poses, pose, goal, rho, period, mean)
    for _ in range(REFINEMENTS):
        centre[0], centre[1], centre[2] = mean[0], mean[1], mean[2]
        count = _inliers(poses, centre, goal, rho, period, mean)
        if count < best:
            break
        best = count
        pose[0], pose[1], pose[2] = centre[0], centre[1], centre[2]
    return float(best / n)
