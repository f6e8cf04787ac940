"""The belief: equally weighted pose particles in the world frame (paper VI)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.job.model import Job

UNREAD = -1
SLIPPERY, ROUGH = 1.0 / 3.0, 1.5
"""How far doubted friction lies outside the job's bounds, in units of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Particles, of which some carry a coefficient of friction of their own.

    Fingers that are more slippery or rougher than the job says are so in every squeeze; a particle without
    one draws another from the job's interval each time.

    Attributes:
        poses: (n, 3) in the world [mm, mm, rad].
        friction: (n,) between fingers and part; NaN where the particle carries none.
        reading: (n,) counts of the last squeeze; `UNREAD` before the first.
    """

    poses: Array
    friction: Array
    reading: IntArray

    @classmethod
    def of(cls, poses: Array, reading: IntArray | None = None) -> Self:
        """Poses (n, 3) without friction of their own."""
        read = np.full(len(poses), UNREAD) if reading is None else reading
        return cls(poses, np.full(len(poses), np.nan), read)

    @classmethod
    def joined(cls, beliefs: Sequence[Belief]) -> Self:
        """The particles of several beliefs, one belief after the other."""
        return cls(
            np.concatenate([belief.poses for belief in beliefs]),
            np.concatenate([belief.friction for belief in beliefs]),
            np.concatenate([belief.reading for belief in beliefs]),
        )

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, rows: slice | IntArray | BoolArray) -> Belief:
        return Belief(self.poses[rows], self.friction[rows], self.reading[rows])


Particles = TypeVar("Particles", Array, Belief)


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


def initial_with_friction(job: Job, n: int, rng: np.random.Generator) -> Belief:
    """Draws n poses as `initial`, a share of them (`friction.doubt`) with friction outside the bounds.

    Half of those lie between `SLIPPERY` times the lower bound and that bound, the others between the upper
    bound and `ROUGH` times that.
    """
    poses = initial(job, n, rng)
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    slippery = rng.uniform(SLIPPERY * low, low, n)
    rough = rng.uniform(high, ROUGH * high, n)
    friction = np.where(rng.random(n) < 0.5, slippery, rough)
    friction[rng.random(n) >= job.friction.doubt] = np.nan
    return replace(Belief.of(poses), friction=friction)


def subsample(particles: Particles, n: int) -> Particles:
    """At most n of the particles, spread evenly through them: the same ones every time."""
    if len(particles) <= n:
        return particles
    return particles[(np.arange(n) * len(particles)) // n]


def replenish(belief: Belief, n: int) -> Belief:
    """At least n particles: a small belief is repeated, and the next squeeze's scatter spreads the copies."""
    if len(belief) >= n:
        return belief
    return belief[np.resize(np.arange(len(belief)), n)]
