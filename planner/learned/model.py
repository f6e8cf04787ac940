"""The learned motion model: the density estimate where it is accurate, direct simulation where it is not.

Two things make the estimate inaccurate, and both show while drawing from it:

- No roll-out lies near a particle: the region was too small, or too thin.
- The belief is denser than the roll-outs, as after a squeeze that leaves most of it in a few poses. The same
  roll-out is then drawn again and again, and with it the one friction and limit surface it happened to have,
  while the simulator would draw new ones. So a roll-out serves one particle of a belief, and the others that
  draw it are simulated. Small beliefs, as in the search, need that less often than large ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.encoder import Encoder
from planner.belief.particles import frictions
from planner.belief.transition import Outcomes, split
from planner.frames import to_hand
from planner.learned.bandwidth import Bandwidths, choose
from planner.learned.kcde import PAPER_MM, Kcde, rows_of
from planner.learned.rollouts import RollOuts
from planner.mechanics.simulator import RollOut, Simulator
from planner.mechanics.squeeze import JAMMED, UNTOUCHED
from planner.mechanics.touch import TOUCHES, meet

FARTHEST = 2.0
"""Distance of the nearest roll-out beyond which a particle is simulated, in spacings of the roll-outs."""
MOST_DRAWS = 1
"""Particles of one belief that one roll-out may serve."""
SET_ASIDE = 2000
"""Roll-outs that the bandwidths are chosen by, or a tenth of all."""


@dataclass(frozen=True, slots=True, eq=False)
class LearnedModel:
    """Motion and sensor model, interchangeable with `planner.belief.transition.MotionModel`.

    Attributes:
        simulator: what the roll-outs were made with, for particles that they do not cover.
        encoder: what reads the widths.
        motion: the estimate.
        status: (n,) status of each of the estimate's roll-outs.
        bandwidths: how the estimate's were chosen; None in paper mode.
        most_draws: particles of one belief that one roll-out may serve; 0 for any number.
        farthest_mm: distance of the nearest roll-out up to which the estimate is used.
    """

    simulator: Simulator
    encoder: Encoder
    motion: Kcde
    status: IntArray
    bandwidths: Bandwidths | None
    most_draws: int
    farthest_mm: float

    @classmethod
    def fit(
        cls, simulator: Simulator, encoder: Encoder, order: int, rolled: RollOuts,
        slope: Array | None = None, paper: bool = False,
    ) -> Self:  # fmt: skip
        """Learns the model from n roll-outs.

        Args:
            simulator: what they were made with.
            encoder: what reads the widths.
            order: rotational order of the part.
            rolled: the roll-outs.
            slope: (n, 4, 3) slopes (`planner.learned.rollouts.slopes`), to carry outcomes over; not done
                if None, and then the estimate alone is far less accurate after the first squeeze.
            paper: as the paper has it: h1 = h2 = 0.5 mm, the nearest 400, nothing carried over, and no direct
                simulation.

        Raises:
            ValueError: too few roll-outs touch the part.
        """
        outline, jaws, rho = simulator.outline, simulator.jaws, simulator.surface.rho_mm
        if paper:
            motion = Kcde.fit(rolled, outline, jaws, rho, order, paper=True)
            return cls(simulator, encoder, motion, rolled.status, None, 0, math.inf)
        touched = np.flatnonzero(meet(outline, jaws, rolled.initial) == TOUCHES)
        stride = max(10, len(touched) // SET_ASIDE)
        aside = touched[::stride]
        kept = np.delete(np.arange(len(rolled.initial)), aside)
        few = rows_of(rolled, kept)
        kept_slope = None if slope is None else slope[kept]
        trial = Kcde.fit(few, outline, jaws, rho, order, PAPER_MM, 0.0, kept_slope)
        bandwidths = choose(trial, rolled.initial[aside], rolled.final[aside])
        whole = Kcde.fit(rolled, outline, jaws, rho, order, PAPER_MM, 0.0, slope)
        motion = bandwidths.applied_to(whole)
        farthest = FARTHEST * motion.grid.spacing_mm
        return cls(simulator, encoder, motion, rolled.status, bandwidths, MOST_DRAWS, farthest)

    def roll_out(
        self, poses: Array, belief: IntArray, rng: np.random.Generator, friction: Array | None = None
    ) -> RollOut:
        """Squeezes poses, as `Simulator.roll_out` does.

        Args:
            poses: (n, 3) in the hand frame, jaws open [mm, mm, rad]; not modified.
            belief: (n,) number of the belief that each is a particle of, from 0 on.
            rng: source of all randomness.
            friction: (n,) of particles that carry one and so are simulated, NaN of the others; None: none do.

        Returns:
            Final poses, widths and statuses; those of the roll-out drawn where the estimate was used.
        """
        drawn = self.motion.sample(poses, rng, self.simulator.workers)
        idle = np.where(drawn.width_mm > 0.0, JAMMED, UNTOUCHED)
        touched = drawn.source >= 0
        status = np.where(touched, self.status[drawn.source], idle)
        given_up = np.zeros(len(poses), np.int64)
        carried = np.full(len(poses), np.nan) if friction is None else friction
        covered = self.covered(drawn.source, drawn.nearest_mm, belief) & np.isnan(carried)
        direct = np.flatnonzero(touched & ~covered)
        parameters = self.simulator.sample(len(direct), rng).rubbing(carried[direct])
        rolled = self.simulator.roll_out(poses[direct], parameters)
        drawn.poses[direct] = rolled.poses
        drawn.width_mm[direct] = rolled.width_mm
        status[direct] = rolled.status
        given_up[direct] = rolled.given_up
        return RollOut(drawn.poses, drawn.width_mm, status, given_up)

    def covered(self, source: IntArray, nearest_mm: Array, belief: IntArray) -> BoolArray:
        """Where a draw from the estimate may stand.

        Args:
            source: (n,) the roll-outs drawn.
            nearest_mm: (n,) distance of the nearest one.
            belief: (n,) number of the belief.
        """
        near = nearest_mm <= self.farthest_mm
        if self.most_draws == 0:
            return near
        key = belief * (len(self.status) + 1) + source
        return near & (_earlier(key) < self.most_draws)

    def squeeze(self, cases: list[tuple[Array, Array]], rng: np.random.Generator) -> list[Outcomes]:
        """Squeezes beliefs at placements.

        Args:
            cases: pairs of a belief (n, 3) in the world, or (n, 4) with friction, and a placement (3,).
            rng: source of all randomness.

        Returns:
            The outcomes, one for each case.
        """
        if not cases:
            return []
        hand = np.concatenate([to_hand(belief, placement) for belief, placement in cases])
        number = np.repeat(np.arange(len(cases)), [len(belief) for belief, _ in cases])
        rolled = self.roll_out(hand, number, rng, frictions([belief for belief, _ in cases]))
        counts = self.encoder.read(rolled.width_mm, rng)
        return split(cases, rolled.poses, rolled.width_mm, rolled.status, counts)


def _earlier(key: IntArray) -> IntArray:
    """How many equal keys stand before each. (n,)."""
    order = np.argsort(key, kind="stable")
    place = np.arange(len(key))
    new = np.ones(len(key), np.bool_)
    new[1:] = key[order][1:] != key[order][:-1]
    earlier = np.empty(len(key), np.int64)
    earlier[order] = place - np.maximum.accumulate(np.where(new, place, 0))
    return earlier
