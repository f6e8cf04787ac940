"""The belief: equally weighted pose particles in the arm's frame, with latent parameters (paper VI)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self, TypeVar

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.job.model import Job
from planner.mechanics.traits import Traits, as_planned, joined, with_hypothesis

UNREAD, PUSHED = -1, -2
RATIO = 1.2207440846057596  # the root of x^4 = x + 1


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Particles: poses, and latent parameters ("traits") that each particle keeps in all squeezes.

    For example, the friction of a particle's fingers is the same in every squeeze.
    """

    poses: Array  # (n, 3) in the world [mm, mm, rad]
    traits: Traits  # (n,)
    # (n,) readings of the last squeeze; before the first squeeze `UNREAD`, or `PUSHED` after a push
    reading: IntArray

    @classmethod
    def of(
        cls, poses: Array, reading: IntArray | None = None, traits: Traits | None = None
    ) -> Self:
        """Returns a belief of particles at poses (n, 3), by default with latent parameters as planned."""
        read = np.full(len(poses), UNREAD) if reading is None else reading
        return cls(poses, as_planned(len(poses)) if traits is None else traits, read)

    @classmethod
    def joined(cls, beliefs: Sequence[Belief]) -> Self:
        """The particles of several beliefs, one belief after the other."""
        return cls(
            np.concatenate([belief.poses for belief in beliefs]),
            joined(belief.traits for belief in beliefs),
            np.concatenate([belief.reading for belief in beliefs]),
        )

    @property
    def states(self) -> Array:
        """Poses (n, 3), with the hypothesis as a fourth column unless all parts have the first one."""
        return with_hypothesis(self.poses, self.traits)

    @property
    def touched(self) -> bool:
        """Whether these parts have been squeezed or pushed at all."""
        return bool(self.reading[0] != UNREAD)

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, rows: slice | IntArray | BoolArray) -> Belief:
        return Belief(self.poses[rows], self.traits[rows], self.reading[rows])


Particles = TypeVar("Particles", Array, Belief)


def initial(job: Job, n: int, rng: np.random.Generator) -> Array:
    """Draws n poses from the job's uncertainty: the centre in a disc, the orientation in its range.

    Returns:
        (n, 3) poses in the world [mm, mm, rad].
    """
    return _poses(job, rng.random((3, n)))


def evenly(job: Job, n: int, rng: np.random.Generator) -> Array:
    """Draws n poses as `initial` does, but on a randomly shifted lattice: plans vary less between seeds.

    The fractional parts of multiples of the inverse powers of `RATIO` fill a cube evenly (Roberts 2018).
    """
    steps = np.outer(RATIO ** -np.arange(1.0, 4.0), np.arange(n))
    return _poses(job, (rng.random((3, 1)) + steps) % 1.0)


def _poses(job: Job, uniform: Array) -> Array:
    """Maps uniform numbers (3, n) in [0, 1) to poses (n, 3) [mm, mm, rad]."""
    radius = job.uncertainty.radius_mm * np.sqrt(uniform[0])
    bearing = 2.0 * np.pi * uniform[1]
    half = np.radians(job.uncertainty.orientation_halfwidth_deg)
    turn = -half + 2.0 * half * uniform[2]
    return np.stack([radius * np.cos(bearing), radius * np.sin(bearing), turn], axis=1)


def subsample(particles: Particles, n: int) -> Particles:
    """At most n of the particles, spread evenly through them: the same ones every time."""
    if len(particles) <= n:
        return particles
    return particles[(np.arange(n) * len(particles)) // n]


def replenish(belief: Belief, n: int) -> Belief:
    """Repeats a small belief up to at least n particles; the next squeeze's scatter spreads the copies."""
    if len(belief) >= n:
        return belief
    return belief[np.resize(np.arange(len(belief)), n)]
