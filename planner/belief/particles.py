"""The belief: equally weighted pose particles in the world frame (paper VI).

A particle of a plan may carry a coefficient of friction of its own, in a fourth column: fingers that are more
slippery or rougher than the job says are so in every squeeze. Those without one (NaN) draw another from the
job's interval each time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from planner.arrays import Array, IntArray
from planner.job.model import Job

SLIPPERY, ROUGH = 1.0 / 3.0, 1.5
"""How far doubted friction lies outside the job's bounds, in units of them."""


def initial(job: Job, n: int, rng: np.random.Generator) -> Array:
    """Draws n poses from the job's uncertainty: the centre in a disc, the orientation in its range.

    Returns:
        (n, 3) poses in the world [mm, mm, rad].
    """
    radius = job.uncertainty.radius_mm * np.sqrt(rng.random(n))
    bearing = rng.uniform(0.0, 2.0 * np.pi, n)
    half = np.radians(job.uncertainty.orientation_halfwidth_deg)
    turn = rng.uniform(-half, half, n)
    return np.stack([radius * np.cos(bearing), radius * np.sin(bearing), turn], axis=1)


def initial_with_friction(job: Job, n: int, rng: np.random.Generator) -> Array:
    """Draws n poses as `initial`, a share of them (`friction.doubt`) with friction outside the bounds.

    Half of those lie between `SLIPPERY` times the lower bound and that bound, the others between the upper
    bound and `ROUGH` times that.

    Returns:
        (n, 4) poses in the world and coefficients of friction, NaN for those of the job [mm, mm, rad, 1].
    """
    poses = initial(job, n, rng)
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    slippery = rng.uniform(SLIPPERY * low, low, n)
    rough = rng.uniform(high, ROUGH * high, n)
    friction = np.where(rng.random(n) < 0.5, slippery, rough)
    friction[rng.random(n) >= job.friction.doubt] = np.nan
    return np.concatenate([poses, friction[:, None]], axis=1)


def without_friction(poses: Array) -> Array:
    """Poses (n, 3) as particles (n, 4) without friction of their own."""
    return np.concatenate([poses, np.full((len(poses), 1), np.nan)], axis=1)


def frictions(beliefs: Sequence[Array]) -> Array:
    """What all particles of several beliefs carry, one belief after the other: (n,), NaN for nothing."""
    carried = [belief[:, 3] if belief.shape[1] > 3 else np.full(len(belief), np.nan) for belief in beliefs]
    return np.concatenate(carried)


def subsample(poses: Array, n: int) -> Array:
    """At most n of the particles, spread evenly through them: the same ones every time."""
    if len(poses) <= n:
        return poses
    picks: IntArray = (np.arange(n) * len(poses)) // n
    return np.asarray(poses[picks])


def replenish(poses: Array, n: int) -> Array:
    """At least n particles: a thin belief is repeated, and the next squeeze's scatter spreads the copies."""
    if len(poses) >= n:
        return poses
    return np.asarray(np.resize(poses, (n, poses.shape[1])))
