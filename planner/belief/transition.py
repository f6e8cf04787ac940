"""Effect of an action on a belief: one child belief per cluster of widths (paper V.A, V.C).

The reference motion model is direct simulation of every particle, each with its own random mechanics and
encoder noise. Many beliefs and actions are rolled out in one batch.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.observation import Encoder, Partition
from planner.belief.particles import PUSHED, UNREAD, Belief
from planner.belief.partition import Rule, partition
from planner.frames import to_hand, to_world
from planner.mechanics.mixture import Mixture
from planner.mechanics.simulator import Simulator
from planner.mechanics.traits import Traits, joined

Case: TypeAlias = tuple[Belief, Array]
"""A belief, and the placement (3,) of the hand that squeezes it [mm, mm, rad]."""


class Push(NamedTuple):
    """A push: the hand comes down beside the part, and moves straight along the x axis of the hand frame."""

    start: Array  # (3,) the hand frame in the world, where it comes down [mm, mm, rad]
    opening_mm: float  # opening of the jaws; 0: closed
    way_mm: float


class Squeezed(NamedTuple):
    """The outcome of one action on one belief."""

    belief: Belief  # n particles after the action, with their readings
    width_mm: float  # mean width at which the jaws stop


class Outcomes(NamedTuple):
    """The branches of one action on one belief."""

    beliefs: list[Belief]  # the particles of each cluster of readings
    width_mm: float  # mean width at which the jaws stop

    @classmethod
    def of(cls, squeezed: Squeezed, rule: Rule) -> Self:
        """Partitions the readings of a squeeze into branches, and returns these."""
        belief, width_mm = squeezed
        label = partition(belief.states, belief.reading, rule)
        return cls([belief[label == k] for k in range(int(label.max()) + 1)], width_mm)

    def without_gaps(self, holds: BoolArray, most: int) -> Self:
        """Splits the branches marked in `holds` (k,) at gaps of more than `most` steps without readings."""
        beliefs = list[Belief]()
        for belief, held in zip(self.beliefs, holds, strict=True):
            counts = np.unique(belief.reading)
            starts = counts[1:][np.diff(counts) > most + 1][: None if held else 0]
            piece = np.searchsorted(starts, belief.reading, side="right")
            beliefs += [belief[piece == k] for k in range(len(starts), -1, -1)]
        return self._replace(beliefs=beliefs)

    @property
    def clusters(self) -> Partition:
        """The partition of the readings."""
        return Partition.of([belief.reading for belief in self.beliefs])

    @property
    def probability(self) -> Array:
        """Share of the belief in each cluster."""
        size = self.clusters.size
        return np.asarray(size / size.sum())


EXACT = np.zeros(3)  # no errors of the arm


def true_placements(
    placements: Array, traits: Traits, rng: Generator, spread: Array = EXACT
) -> Array:
    """Where the fingers really meet when the arm sends the hand to placements (n, 3) [mm, mm, rad].

    The arm has random errors. The traits state how far off the middle of the hand the fingers meet. The
    number of random draws does not depend on the errors, so that trials are comparable one by one.

    Args:
        placements: where the arm sends the hand.
        traits: (n,) latent parameters of part and cell.
        rng: draws the errors of the arm.
        spread: (3,) standard deviations of the arm's errors, drawn for every squeeze.
    """
    placed = placements + spread * rng.standard_normal(placements.shape)
    closing = np.stack([-np.sin(placed[:, 2]), np.cos(placed[:, 2])], axis=1)
    placed[:, :2] += traits["across_mm"][:, None] * closing
    return np.asarray(placed)


def read_as(width_mm: Array, traits: Traits) -> Array:
    """Widths (n,) as an encoder with these traits (n,) measures them, before noise and rounding."""
    return np.asarray(width_mm * (1.0 + traits["gain"]) + traits["encoder_mm"])


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """Motion and sensor model that simulates every particle by itself."""

    simulator: Simulator | Mixture
    encoder: Encoder

    def squeeze(self, cases: list[Case], rng: Generator) -> list[Squeezed]:
        """Squeezes beliefs at placements in one batch, each particle by itself, and reads the widths.

        Args:
            cases: pairs of a belief and a placement (3,) in the world [mm, mm, rad].
            rng: source of all randomness.

        Returns:
            One outcome for each case.
        """
        if not cases:
            return []
        size = np.array([len(belief) for belief, _ in cases])
        traits = joined(belief.traits for belief, _ in cases)
        placements = np.repeat([placement for _, placement in cases], size, axis=0)
        poses = np.concatenate([belief.poses for belief, _ in cases])
        after, counts, width_mm = self._squeezed(poses, placements, traits, rng)
        stops = np.cumsum(size)
        mean_mm = np.add.reduceat(width_mm, stops - size) / size
        pieces = np.split(after, stops[:-1]), np.split(counts, stops[:-1])
        each = zip(cases, *pieces, mean_mm.tolist(), strict=True)
        return [
            Squeezed(Belief(lying, belief.traits, reading), width)
            for (belief, _), lying, reading, width in each
        ]

    def squeeze_at_each(
        self, belief: Belief, placements: Array, rng: Generator
    ) -> tuple[Array, IntArray]:
        """Squeezes all n particles of a belief at each of k placements (k, 3) in the world [mm, mm, rad].

        Returns:
            Final poses (k, n, 3) in the world, and readings (k, n).
        """
        k, n = len(placements), len(belief)
        poses, traits = np.tile(belief.poses, (k, 1)), joined([belief.traits] * k)
        hands = np.repeat(placements, n, axis=0)
        after, counts, _ = self._squeezed(poses, hands, traits, rng)
        return after.reshape(k, n, 3), counts.reshape(k, n)

    def _squeezed(
        self, poses: Array, placements: Array, traits: Traits, rng: Generator
    ) -> tuple[Array, IntArray, Array]:
        """Squeezes particles at poses (n, 3) with the hand at placements (n, 3), both in the world.

        Returns:
            Final poses (n, 3) in the world, readings (n,), and the widths (n,) at which the jaws stop [mm].
        """
        hand = true_placements(placements, traits, rng)
        rolled = self.simulator.squeeze(to_hand(poses, hand.T), rng, traits)
        counts = self.encoder.read(read_as(rolled.width_mm, traits), rng)
        counts = self.encoder.with_flag(counts, rolled.width_mm)
        return to_world(rolled.poses, hand.T), counts, rolled.width_mm

    def push(self, belief: Belief, push: Push, rng: Generator) -> Belief:
        """The belief after a push, each particle rolled out by itself."""
        n = len(belief)
        hand = true_placements(np.tile(push.start, (n, 1)), belief.traits, rng)
        opening, way = np.full(n, push.opening_mm), np.full(n, push.way_mm)
        lying = to_hand(belief.poses, hand.T)
        ends = self.simulator.push_by_hand(lying, opening, way, rng, belief.traits)
        reading = np.where(belief.reading == UNREAD, PUSHED, belief.reading)
        return Belief(to_world(ends, hand.T), belief.traits, reading)


def finger_speed_mm_s(speed_mm_s: float) -> float:
    """Speed of one finger while the jaws close at `speed_mm_s`; a push moves the hand at the same speed."""
    return 0.5 * speed_mm_s
