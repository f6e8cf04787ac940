"""What a squeeze makes of a belief: one child belief per cluster of widths (paper V.A, V.C).

The motion model is direct simulation of every particle, each with its own random mechanics and encoder noise.
Many beliefs and actions are rolled out in one batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.encoder import Encoder
from planner.frames import to_hand, to_world
from planner.mechanics.simulator import Simulator
from planner.models.partition import Partition, partition


class Outcomes(NamedTuple):
    """The outcomes of one action on one belief.

    Attributes:
        clusters: the partition of encoder counts.
        beliefs: for each cluster the particles in it, (n_k, 3) in the world.
    """

    clusters: Partition
    beliefs: list[Array]

    @property
    def probability(self) -> Array:
        """Share of the belief in each cluster."""
        return np.asarray(self.clusters.size / self.clusters.size.sum())


@dataclass(frozen=True, slots=True, eq=False)
class MotionModel:
    """Direct simulation as the motion and sensor model."""

    simulator: Simulator
    encoder: Encoder

    def squeeze(self, cases: list[tuple[Array, Array]], rng: np.random.Generator) -> list[Outcomes]:
        """Squeezes beliefs at placements.

        Args:
            cases: pairs of a belief (n, 3) in the world and a placement (3,).
            rng: source of all randomness.

        Returns:
            The outcomes, one for each case.
        """
        if not cases:
            return []
        hand = np.concatenate([to_hand(belief, placement) for belief, placement in cases])
        rolled = self.simulator.roll_out(hand, self.simulator.sample(len(hand), rng))
        counts = self.encoder.read(rolled.width_mm, rng)
        outcomes = []
        start = 0
        for belief, placement in cases:
            part = slice(start, start + len(belief))
            start += len(belief)
            poses = to_world(rolled.poses[part], placement)
            clusters = partition(counts[part])
            label = clusters.label[counts[part]]
            outcomes.append(Outcomes(clusters, [poses[label == k] for k in range(len(clusters.mean))]))
        return outcomes
