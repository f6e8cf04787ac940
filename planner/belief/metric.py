"""When is a part located: the audit metric, and how near a belief is to that (paper VI.1, eq. 9).

The paper averages the poses and counts those near the average; for a belief of two modes the average lies
between them and counts nothing. The *mode ratio* is the largest share of the belief within the goal of one
pose: it grows with progress, and that pose is the right prediction. Where the goal allows several modes, it
is the share within the goal of any of them.
"""

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray
from planner.frames import wrap
from planner.job.model import Job
from planner.kernel import inner_kernel, kernel

CANDIDATES = 48
REFINEMENTS = 4


class Mode(NamedTuple):
    """The pose that explains most of a belief; further ones where the goal allows them.

    Attributes:
        pose: (3,) [mm, mm, rad].
        ratio: share of the belief within the goal of it, or of one of the others.
        others: (m, 3) further poses.
    """

    pose: Array
    ratio: float
    others: Array = np.zeros((0, 3))


class Metric(NamedTuple):
    """How far from the truth a prediction is, under the part's rotational symmetry.

    For kinds "pose" and "modes" d(q1, q2) = sqrt(dx^2 + dy^2) + rho dtheta in mm (eq. 9); for "tolerances"
    and "orientation" the largest deviation in units of its tolerance, so that the goal is 1.

    Attributes:
        distance_mm: the goal of d.
        rho_mm: what one radian weighs.
        order: rotational order of the part.
        kind: one of `runtime.table.KINDS`.
        tolerance: bounds on x, y [mm] and theta [rad].
        modes: how many poses a prediction may name.
    """

    distance_mm: float
    rho_mm: float
    order: int
    kind: str = "pose"
    tolerance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    modes: int = 1

    @property
    def goal(self) -> float:
        """What the distance must stay below."""
        return self.distance_mm if self.kind in ("pose", "modes") else 1.0

    def weights(self) -> Array:
        """(4,) for the kernels: 1 to add deviations up or 0 to take the largest; 1 / goal of each of them."""
        if self.kind in ("pose", "modes"):
            length = 1.0 / self.distance_mm
            return np.array([1.0, length, length, length * self.rho_mm])
        x, y, theta = self.tolerance
        lengths = [1.0 / x, 1.0 / y] if self.kind == "tolerances" else [0.0, 0.0]
        return np.array([0.0, *lengths, 1.0 / theta])

    def between(self, poses: Array, reference: Array) -> Array:
        """Distances of poses (..., 3 or more) to reference poses, broadcast against them."""
        added, x, y, theta = self.weights()
        dx = x * np.abs(poses[..., 0] - reference[..., 0])
        dy = y * np.abs(poses[..., 1] - reference[..., 1])
        turn = theta * np.abs(wrap(poses[..., 2] - reference[..., 2], self.order))
        if added:
            return np.asarray(self.goal * (np.hypot(dx, dy) + turn))
        return np.asarray(self.goal * np.maximum(np.maximum(dx, dy), turn))

    def reached(self, poses: Array, reference: Array) -> BoolArray:
        """Where the distance is below the goal."""
        return np.asarray(self.between(poses, reference) < self.goal)

    def mode(self, poses: Array) -> Mode:
        """The pose with most of the belief within the goal, or as many poses as the goal allows.

        Args:
            poses: (n, 3) particles, n >= 1 [mm, mm, rad].
        """
        found = self.main_modes(poses, self.modes)
        ratio = min(1.0, sum(mode.ratio for mode in found))
        return Mode(found[0].pose, ratio, np.array([mode.pose for mode in found[1:]]).reshape(-1, 3))

    def main_modes(self, poses: Array, most: int, least_share: float = 0.0) -> list[Mode]:
        """The heaviest modes, one after the other: each explains what those before it do not.

        Args:
            poses: (n, 3) particles, n >= 1 [mm, mm, rad].
            most: how many at most.
            least_share: lighter ones are not sought, except for the first.

        Returns:
            Single modes, each with its share of all the particles.
        """
        weights, total = self.weights(), len(poses)
        rest = np.ascontiguousarray(poses)
        found: list[Mode] = []
        while len(found) < most and len(rest) and (not found or len(rest) >= least_share * total):
            pose = np.empty(3)
            share = float(largest_mode(rest, weights, self.order, pose)) * len(rest) / total
            if found and share < least_share:
                break
            found.append(Mode(pose, share))
            if most > 1:
                rest = rest[~self.reached(rest, pose)]
        return found


def metric_of(job: Job, rho_mm: float) -> Metric:
    """The metric of a job's goal."""
    goal = job.goal
    tolerance = (*goal.tolerance_mm, math.radians(goal.tolerance_deg))
    modes = goal.modes if goal.kind == "modes" else 1
    return Metric(goal.distance_mm, rho_mm, job.part.symmetry, goal.kind, tolerance, modes)


@inner_kernel
def inliers(poses: Array, centre: Array, weights: Array, period: float, mean: Array) -> int:
    """Counts poses within the goal of `centre`; `mean` (3,) receives their mean, taken about it."""
    count = 0
    mean[0] = mean[1] = mean[2] = 0.0
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - centre[0], poses[i, 1] - centre[1]
        turn = poses[i, 2] - centre[2]
        turn -= period * np.round(turn / period)
        x, y, angle = weights[1] * dx, weights[2] * dy, weights[3] * abs(turn)
        distance = np.sqrt(x * x + y * y) + angle if weights[0] > 0.0 else max(abs(x), abs(y), angle)
        if distance < 1.0:
            count += 1
            mean[0] += dx
            mean[1] += dy
            mean[2] += turn
    for j in range(3):
        mean[j] = centre[j] + mean[j] / max(count, 1)
    return count


@kernel
def largest_mode(poses: Array, weights: Array, order: int, pose: Array) -> float:
    """Share of the poses within the goal of the best pose found.

    Starts from poses spread evenly through the belief and climbs from the better ones to the mean of what is
    within the goal (mean shift with a flat kernel).

    Args:
        poses: (n, 3), n >= 1 [mm, mm, rad].
        weights: (4,) of the metric.
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
        count = inliers(poses, centre, weights, period, mean)
        if 2 * count < best:
            continue
        for _ in range(REFINEMENTS):
            if count > best:
                best = count
                pose[0], pose[1], pose[2] = centre[0], centre[1], centre[2]
            centre[0], centre[1], centre[2] = mean[0], mean[1], mean[2]
            last = count
            count = inliers(poses, centre, weights, period, mean)
            if count < last:
                break
        if count > best:
            best = count
            pose[0], pose[1], pose[2] = centre[0], centre[1], centre[2]
        if best == n:
            break
    # Among equals the mean is the better prediction.
    inliers(poses, pose, weights, period, mean)
    for _ in range(REFINEMENTS):
        centre[0], centre[1], centre[2] = mean[0], mean[1], mean[2]
        count = inliers(poses, centre, weights, period, mean)
        if count < best:
            break
        best = count
        pose[0], pose[1], pose[2] = centre[0], centre[1], centre[2]
    return float(best / n)
