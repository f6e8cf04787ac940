"""Slow, obvious twins of the motion model's kernels: every roll-out against every pose, in numpy.

And the estimate as a motion model by itself, without direct simulation where it is thin.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from planner.belief.particles import Belief
from planner.belief.transition import Case
from planner.frames import to_hand, to_world
from planner.learned.kcde import Kcde


def offsets(poses: np.ndarray, others: np.ndarray, rho: float, order: int) -> np.ndarray:
    """Normalised differences (n, m, 3) of poses (n, 3) from others (m, 3), the angle wrapped."""
    difference = poses[:, None] - others[None]
    period = math.tau / order
    turn = difference[..., 2] - period * np.round(difference[..., 2] / period)
    return np.stack([difference[..., 0], difference[..., 1], rho * turn], axis=-1)


def weights(
    poses: np.ndarray, initial: np.ndarray, rho: float, order: int, h1: float
) -> np.ndarray:
    """Equation 8 over all roll-outs, (n, m)."""
    square = (offsets(poses, initial, rho, order) ** 2).sum(axis=-1)
    log_weight = -0.5 * square / h1**2
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return weight / weight.sum(axis=1, keepdims=True)


def density(
    poses: np.ndarray,
    finals: np.ndarray,
    initial: np.ndarray,
    end: np.ndarray,
    rho: float,
    order: int,
    h1: float,
    h2: np.ndarray,
) -> np.ndarray:
    """Equation 7 at outcomes (n, 3) of poses (n, 3), h2 (m, 3) by roll-out and coordinate. (n,)."""
    z = offsets(finals, end, rho, order) / h2[None]
    kernel = np.exp(-0.5 * (z**2).sum(axis=-1)) / (h2.prod(axis=1) * math.tau**1.5)[None]
    return (weights(poses, initial, rho, order, h1) * kernel).sum(axis=1)


def energy_distance(a: np.ndarray, b: np.ndarray, rho: float, order: int) -> float:
    """Energy distance with every pair written out."""

    def points(poses: np.ndarray) -> np.ndarray:
        around = np.exp(1j * order * poses[:, 2]) * rho / order
        return np.column_stack([poses[:, :2], around.real, around.imag])

    def mean(p: np.ndarray, q: np.ndarray) -> float:
        return float(np.linalg.norm(p[:, None] - q[None], axis=-1).mean())

    first, second = points(a), points(b)
    return 2 * mean(first, second) - mean(first, first) - mean(second, second)


class Unaided(NamedTuple):
    """An estimate in place of a motion model, as the paper uses it."""

    motion: Kcde

    def squeeze(self, cases: list[Case], rng: np.random.Generator) -> list[SimpleNamespace]:
        """As `MotionModel.squeeze`, without readings."""
        moved = [
            self.motion.sample(to_hand(belief.poses, hand), rng).poses for belief, hand in cases
        ]
        return [
            SimpleNamespace(belief=Belief.of(to_world(poses, hand)))
            for poses, (_, hand) in zip(moved, cases, strict=True)
        ]
