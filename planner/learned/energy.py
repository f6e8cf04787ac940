"""Energy distance between two samples of poses, and a motion model's push-forward judged by it.

    E(A, B) = 2 mean|a - b| - mean|a - a'| - mean|b - b'|        (Szekely and Rizzo 2013)

with all pairs in the means, also of a pose with itself. It is zero for equal samples only, and needs no bins.
Poses are compared as points (x, y, r cos n theta, r sin n theta), r = rho / n: near one another that is the
paper's normalised pose (V.A), it has no seam where the angle wraps under the rotational order n, and
distances between points of a Euclidean space are what makes E a distance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import Belief
from planner.belief.transition import MotionModel
from planner.kernel import kernel


class Comparison(NamedTuple):
    """A model's push-forward of a belief beside the simulator's, after some squeezes.

    Attributes:
        squeezes: how many squeezes.
        model_mm: energy distance between a run of the model and one of the simulator, mean over all pairs.
        simulator_mm: energy distance between two runs of the simulator, mean over all pairs.
    """

    squeezes: int
    model_mm: float
    simulator_mm: float

    @property
    def ratio(self) -> float:
        """How much farther the model is from the simulator than the simulator is from itself."""
        if self.model_mm == self.simulator_mm:
            return 1.0
        return self.model_mm / self.simulator_mm if self.simulator_mm > 0.0 else float("inf")


def energy_distance(a: Array, b: Array, rho_mm: float, order: int = 1) -> float:
    """Energy distance of two samples of poses [mm].

    Args:
        a: (n, 3) poses, n >= 1 [mm, mm, rad].
        b: (m, 3) poses, m >= 1.
        rho_mm: what one radian weighs.
        order: rotational order of the part.

    Returns:
        At least 0.
    """
    first, second = points_of(a, rho_mm, order), points_of(b, rho_mm, order)
    return _energy(first, second, float(_mean_within(first)), float(_mean_within(second)))


def compare(
    model: MotionModel, reference: MotionModel, beliefs: Sequence[Array], placements: Array, rho_mm: float,
    order: int, rng: np.random.Generator,
) -> list[Comparison]:  # fmt: skip
    """Compares push-forwards of a belief through a sequence of squeezes.

    Runs that start from the same particles differ by the squeezes' doing alone: that is the strictest
    comparison. Runs that start from particles of their own also differ as samples of one belief do.

    Args:
        model: the motion model in question.
        reference: the simulator as a motion model.
        beliefs: (n, 3) particles in the world that each run starts from, n >= 1 [mm, mm, rad]: as many runs
            of the simulator, at least 2, after as many of the model.
        placements: (k, 3) where the hand squeezes, one after the other.
        rho_mm: what one radian weighs.
        order: rotational order of the part.
        rng: source of all randomness.

    Returns:
        One comparison for each number of squeezes, 1 to k.
    """
    half = len(beliefs) // 2
    streams = list(zip(beliefs, rng.spawn(2 * half), strict=True))
    runs = [_push(model, Belief.of(belief), placements, stream) for belief, stream in streams[:half]]
    truth = [_push(reference, Belief.of(belief), placements, stream) for belief, stream in streams[half:]]
    comparisons = []
    for k in range(len(placements)):
        tried = [points_of(run[k], rho_mm, order) for run in runs]
        true = [points_of(run[k], rho_mm, order) for run in truth]
        comparisons.append(_compared(k + 1, tried, true))
    return comparisons


def _push(model: MotionModel, belief: Belief, placements: Array, rng: np.random.Generator) -> list[Array]:
    """The poses (n, 3) after each of a sequence of squeezes."""
    beliefs = []
    for placement in placements:
        belief = model.squeeze([(belief, placement)], rng)[0].belief
        beliefs.append(belief.poses)
    return beliefs


def _compared(squeezes: int, tried: list[Array], true: list[Array]) -> Comparison:
    """The comparison of a model's runs (n, 4) with the simulator's."""
    within = [float(_mean_within(points)) for points in true]
    scores = []
    for points in tried:
        own = float(_mean_within(points))
        scores.append(np.mean([_energy(points, b, own, w) for b, w in zip(true, within, strict=True)]))
    pairs = [_energy(true[i], true[j], within[i], within[j]) for i in range(len(true)) for j in range(i)]
    return Comparison(squeezes, float(np.mean(scores)), float(np.mean(pairs)))


def _energy(a: Array, b: Array, within_a: float, within_b: float) -> float:
    """Energy distance of points (n, 4) and (m, 4), given their mean distances within."""
    return max(2.0 * float(_mean_distance(a, b)) - within_a - within_b, 0.0)


def points_of(poses: Array, rho_mm: float, order: int) -> Array:
    """Poses (n, 3) as points (n, 4) whose Euclidean distances respect the part's symmetry [mm]."""
    turn = order * poses[:, 2]
    radius = rho_mm / order
    return np.column_stack([poses[:, 0], poses[:, 1], radius * np.cos(turn), radius * np.sin(turn)])


@kernel
def _mean_distance(a: Array, b: Array) -> float:
    """Mean distance between points (n, 4) and points (m, 4)."""
    total = 0.0
    for i in range(a.shape[0]):
        row = 0.0
        for j in range(b.shape[0]):
            d0, d1 = a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]
            d2, d3 = a[i, 2] - b[j, 2], a[i, 3] - b[j, 3]
            row += np.sqrt(d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3)
        total += row
    return float(total / a.shape[0] / b.shape[0])


@kernel
def _mean_within(a: Array) -> float:
    """Mean distance between points (n, 4), each with itself included."""
    total = 0.0
    for i in range(a.shape[0]):
        row = 0.0
        for j in range(i):
            d0, d1 = a[i, 0] - a[j, 0], a[i, 1] - a[j, 1]
            d2, d3 = a[i, 2] - a[j, 2], a[i, 3] - a[j, 3]
            row += np.sqrt(d0 * d0 + d1 * d1 + d2 * d2 + d3 * d3)
        total += row
    return float(2.0 * total / a.shape[0] / a.shape[0])
