"""What a squeeze makes of a belief, and its cost: one child belief per cluster of widths (paper V.A, V.C).

The reference motion model is direct simulation of every particle, each with its own random mechanics and
encoder noise. Many beliefs and actions are rolled out in one batch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.observation import Encoder, Partition, partition
from planner.belief.particles import frictions
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.simulator import Simulator
from planner.mechanics.squeeze import JAMMED

LEAST_SQUEEZE = 0.001
"""A squeeze that costs nothing still costs this much: of two plans as good the shorter is better."""


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
        rolled = self.simulator.roll_out(hand, self.simulator.sample(len(hand), rng).with_friction(friction))
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


class Costs(NamedTuple):
    """The price of a squeeze, in units of itself: 1, and something for its time and for its risk.

    Attributes:
        squeeze: of any, as a probability of success.
        second: of a second of cell time, likewise.
        unstable: of an outcome that friction alone holds, likewise.
        lift_s: time to go up and come down again [s].
        opening_mm: stroke of the open jaws.
        speed_mm_s: rate at which the opening closes.
    """

    squeeze: float
    second: float
    unstable: float
    lift_s: float
    opening_mm: float
    speed_mm_s: float

    @property
    def least(self) -> float:
        """What a squeeze costs at least, as a probability of success."""
        return max(self.squeeze, LEAST_SQUEEZE)

    def of(self, outcomes: Outcomes) -> float:
        """C of an action with these outcomes, in squeezes."""
        seconds = self.lift_s + 2.0 * (self.opening_mm - outcomes.width_mm) / self.speed_mm_s
        extra = self.second * seconds + self.unstable * outcomes.unstable
        return 1.0 + extra / self.least


def costs_of(job: Job) -> Costs:
    """The costs that a job states."""
    search, cell, gripper = job.search, job.cell, job.gripper
    lift = 2.0 * (cell.retreat_height_mm - cell.squeeze_height_mm) / cell.arm_speed_mm_s
    return Costs(
        search.squeeze_cost, search.second_cost, search.stability_cost, lift, gripper.opening_mm,
        gripper.speed_mm_s,
    )  # fmt: skip
