"""What a squeeze makes of a belief: one child belief per cluster of widths (paper V.A, V.C).

The reference motion model is direct simulation of every particle, each with its own random mechanics and
encoder noise. Many beliefs and actions are rolled out in one batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.encoder import Encoder
from planner.belief.observation import Partition, partition
from planner.belief.particles import frictions
from planner.frames import to_hand, to_world
from planner.mechanics.simulator import Simulator
from planner.mechanics.squeeze import JAMMED


class Outcomes(NamedTuple):
    """The outcomes of one action on one belief.

    Attributes:
        clusters: the partition of encoder counts.
        beliefs: for each cluster the particles in it, (n_k, 3) in the world, or (n_k, 4) with their friction.
        unstable: share of the belief that is held by friction alone (jammed): stiff jaws on a light part may
            throw it out of such an equilibrium (paper VII.B).
        width_mm: mean width at which the jaws stop.
    """

    clusters: Partition
    beliefs: list[Array]
    unstable: float
    width_mm: float

    @property
    def probability(self) -> Array:
        """Share of the belief in each cluster."""
        return np.asarray(self.clusters.size / self.clusters.size.sum())


class MotionModel(Protocol):
    """What the search needs to know of a squeeze."""

    def squeeze(self, cases: list[tuple[Array, Array]], rng: np.random.Generator) -> list[Outcomes]:
        """Squeezes beliefs at placements.

        Args:
            cases: pairs of a belief (n, 3) in the world, or (n, 4) with friction, and a placement (3,).
            rng: source of all randomness.

        Returns:
            The outcomes, one for each case.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """Direct simulation as the motion and sensor model."""

    simulator: Simulator
    encoder: Encoder

    def squeeze(self, cases: list[tuple[Array, Array]], rng: np.random.Generator) -> list[Outcomes]:
        """As `MotionModel.squeeze`, each particle rolled out by itself."""
        if not cases:
            return []
        hand = np.concatenate([to_hand(belief, placement) for belief, placement in cases])
        friction = frictions([belief for belief, _ in cases])
        rolled = self.simulator.roll_out(hand, self.simulator.sample(len(hand), rng).rubbing(friction))
        counts = self.encoder.read(rolled.width_mm, rng)
        return split(cases, rolled.poses, rolled.width_mm, rolled.status, counts)


def split(
    cases: list[tuple[Array, Array]], poses_hand: Array, width_mm: Array, status: IntArray, counts: IntArray
) -> list[Outcomes]:
    """Divides what many squeezes came to into the outcomes of each case.

    Args:
        cases: as given to the motion model, n particles in all.
        poses_hand: (n, 3) final poses in the hand frame.
        width_mm: (n,) true widths.
        status: (n,) index into `STATUS_NAMES`.
        counts: (n,) encoder readings.
    """
    outcomes = []
    start = 0
    for belief, placement in cases:
        part = slice(start, start + len(belief))
        start += len(belief)
        poses = np.concatenate([to_world(poses_hand[part], placement), belief[:, 3:]], axis=1)
        clusters = partition(counts[part])
        label = clusters.label[counts[part]]
        beliefs = [poses[label == k] for k in range(len(clusters.mean))]
        unstable = float(np.mean(status[part] == JAMMED))
        outcomes.append(Outcomes(clusters, beliefs, unstable, float(np.mean(width_mm[part]))))
    return outcomes
