"""The energy distance of two samples of poses, and push-forwards of a belief compared by it.

A motion model's push-forward is judged by the energy distance between two samples of poses,

    E(A, B) = 2 mean|a - b| - mean|a - a'| - mean|b - b'|        (Szekely and Rizzo 2013)

with all pairs in the means, also of a pose with itself. It is zero for equal samples only, and needs no bins.
Poses are compared as points (x, y, r cos n theta, r sin n theta), r = rho / n: near one another that is the
paper's normalised pose (V.A), without a seam where the angle wraps under the rotational order n.
"""

from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import Belief
from planner.belief.transition import MotionModel


class Comparison(NamedTuple):
    """A model's push-forward of a belief beside the simulator's, after some squeezes."""

    squeezes: int  # how many
    model_mm: (
        float  # energy distance of a run of the model from one of the simulator, mean of all pairs
    )
    simulator_mm: float  # the same between two runs of the simulator

    @property
    def ratio(self) -> float:
        """How much farther the model is from the simulator than the simulator is from itself."""
        if self.model_mm == self.simulator_mm:
            return 1.0
        return self.model_mm / self.simulator_mm if self.simulator_mm > 0.0 else float("inf")


def energy_distance(a: Array, b: Array, rho_mm: float, order: int = 1) -> float:
    """Energy distance of two samples of poses (n, 3) and (m, 3), n, m >= 1 [mm]; at least 0.

    `rho_mm` is what one radian weighs, `order` the part's rotational order.
    """
    from scipy.spatial.distance import cdist  # half as long to import as numba

    radius = rho_mm / order

    def points(poses: Array) -> Array:
        """(n, 4) whose Euclidean distances respect the part's symmetry [mm]."""
        turn = order * poses[:, 2]
        return np.column_stack(
            [poses[:, 0], poses[:, 1], radius * np.cos(turn), radius * np.sin(turn)]
        )

    first, second = points(a), points(b)
    within = float(cdist(first, first).mean() + cdist(second, second).mean())
    return max(2.0 * float(cdist(first, second).mean()) - within, 0.0)


def compare(
    model: MotionModel,
    reference: MotionModel,
    beliefs: Sequence[Array],
    placements: Array,
    rho_mm: float,
    order: int,
    rng: np.random.Generator,
) -> list[Comparison]:
    """Compares push-forwards of a belief through squeezes at placements (k, 3), one comparison after each.

    Runs that start from the same particles differ by the squeezes' doing alone: that is the strictest
    comparison. Runs that start from particles of their own also differ as samples of one belief do. Each run
    starts from (n, 3) particles in the world, n >= 1 [mm, mm, rad]: as many runs of the simulator
    (`reference`), at least 2, after as many of the model. `rho_mm` is what one radian weighs, `order` the
    part's rotational order.
    """
    half = len(beliefs) // 2
    models = [model] * half + [reference] * half
    runs = [
        _push(squeezer, Belief.of(belief), placements, stream)
        for squeezer, belief, stream in zip(models, beliefs, rng.spawn(2 * half), strict=True)
    ]

    def mean_mm(k: int, pairs: list[tuple[list[Array], list[Array]]]) -> float:
        return float(np.mean([energy_distance(a[k], b[k], rho_mm, order) for a, b in pairs]))

    tried, true = runs[:half], runs[half:]
    between, within = list(product(tried, true)), list(combinations(true, 2))
    return [
        Comparison(k + 1, mean_mm(k, between), mean_mm(k, within)) for k in range(len(placements))
    ]


def _push(
    model: MotionModel, belief: Belief, placements: Array, rng: np.random.Generator
) -> list[Array]:
    """The poses (n, 3) after each of a sequence of squeezes."""
    poses = []
    for placement in placements:
        belief = model.squeeze([(belief, placement)], rng)[0].belief
        poses.append(belief.poses)
    return poses
