"""The belief: equally weighted pose particles in the world frame (paper VI)."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, IntArray
from planner.job import Job


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
    return np.asarray(np.resize(poses, (n, 3)))
