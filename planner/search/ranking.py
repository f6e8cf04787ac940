"""Ranking of candidate squeezes of a belief, by simulation and sequential halving."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.metric import mode_shares
from planner.belief.particles import PUSHED, Belief
from planner.belief.partition import Costs, by_group, interval_of_each
from planner.belief.stopping import squeezes_left
from planner.belief.transition import Simulation
from planner.frames import wrap
from planner.kernel import kernel
from planner.mechanics.clearance import free_placements
from planner.mechanics.traits import by_hypothesis
from planner.problem import Problem
from planner.search.actions import ActionSet
from planner.search.proposals import VARIED, varied
from planner.work.scheduler import Threads

LEAST_CLEARANCE_MM = 0.5  # least distance between open fingers and a particle
FINALISTS = 8  # grasp poses judged by all particles; of more, half are dropped after each round
FIRST_SHARE = 0.04  # share of the particles in the first round; it doubles in each further round
FIRST_PARTICLES = 16  # least number of particles in a round
VARIED_BEST = 4  # grasp poses that get variants, and variants of each
ALIKE_MM, ALIKE = 6.0, np.radians(20.0)  # distance below which grasp poses are variants of one
TOGETHER = 32  # options that a thread judges at once
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # fractions of its multiples fill an interval evenly


class Options(NamedTuple):
    """Grasp poses of one belief, the best first.

    Attributes:
        placements: (k, 3) poses of the hand in the world.
        squeezes: (k,) expected number of squeezes until the end: one at the grasp pose, plus the leaf
            heuristic after it.
    """

    placements: Array
    squeezes: Array

    @classmethod
    def sorted(cls, placements: Array, squeezes: Array) -> Options:
        """Options in the order of rising expected squeezes."""
        order = np.argsort(squeezes, kind="stable")
        return cls(placements[order], squeezes[order])


class _Contest:
    """A sequential halving of a belief's grasp poses: the remaining ones, and their outcomes so far."""

    def __init__(self, belief: Belief, placements: Array) -> None:
        """Sets up the first round; with many options it uses few particles, spread evenly in the belief."""
        self.belief, self.placements = belief, placements
        self.stop, k = len(belief), len(placements)  # particles after this round
        if k > FINALISTS:
            self.stop = min(self.stop, max(FIRST_PARTICLES, round(FIRST_SHARE * self.stop)))
            spread = np.arange(len(belief)) * GOLDEN % 1.0
            self.belief = belief[np.argsort(spread, kind="stable")]
        # Outcomes of all particles so far, for each option: poses (k, n, 3) and readings (k, n).
        self.poses, self.reading = np.zeros((k, 0, 3)), np.zeros((k, 0), np.int64)
        self.squeezes = np.zeros(k)  # latest estimates

    @property
    def start(self) -> int:
        """Number of particles that have been squeezed."""
        return int(self.reading.shape[1])

    @property
    def waiting(self) -> bool:
        """Whether options and particles are left to be squeezed."""
        return self.start < len(self.belief) and len(self.placements) > 0

    def squeeze(self, ahead: Simulation, rng: Generator) -> None:
        """Squeezes the particles of this round at every option."""
        now = self.belief[self.start : self.stop]
        poses, reading = ahead.squeeze_at_each(now, self.placements, rng)
        self.poses = np.concatenate([self.poses, poses], axis=1)
        self.reading = np.concatenate([self.reading, reading], axis=1)

    def states(self, hypotheses: bool) -> Array:
        """Final states (k, n, m) of all particles so far; the hypothesis is a column if `hypotheses`."""
        if not hypotheses:
            return self.poses
        hypothesis = self.belief.traits["hypothesis"][: self.start].astype(np.float64)
        fourth = np.broadcast_to(hypothesis[:, None], (*self.poses.shape[:2], 1))
        return np.concatenate([self.poses, fourth], axis=2)

    def halve(self, squeezes: Array) -> None:
        """Keeps the better half of the options, at least `FINALISTS`, while particles are left to squeeze."""
        self.squeezes = squeezes
        if self.waiting:
            most = max(FINALISTS, -(-len(self.placements) // 2))
            kept = np.sort(np.argsort(squeezes, kind="stable")[:most])
            self.placements = self.placements[kept]
            self.poses, self.reading = self.poses[kept], self.reading[kept]
            last = len(kept) <= FINALISTS
            self.stop = len(self.belief) if last else min(len(self.belief), 2 * self.stop)


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """Simulates and ranks the candidate squeezes of beliefs."""

    problem: Problem
    actions: ActionSet

    def candidates(self, belief: Belief, about: Belief) -> Array:
        """Proposes grasp poses (k, 3) for a belief, and keeps those at which open fingers clear it.

        Args:
            belief: the belief that open fingers have to clear, as `free` describes.
            about: the belief itself or a sample of it; its poses decide which grasp poses are proposed.
        """
        if self.actions.first is not None and not belief.touched:
            return self.free(belief, self.actions.first)
        sides = self.actions.along_sides(about.states, self.problem.metric)
        blocked = ~self._clear(belief, sides.about_modes, LEAST_CLEARANCE_MM) & belief.touched
        along = np.where(blocked[:, None], sides.about_middles, sides.about_modes)
        options = [self.actions.placements, along]
        if belief.reading[0] == PUSHED:
            options.append(self.actions.followed(about.poses))
        return self.free(belief, np.concatenate(options))

    def rank(self, belief: Belief, placements: Array, rng: Generator) -> Options:
        """Ranks grasp poses (k, 3) of a belief: drops the worse ones early, judges the rest by all particles.

        The ranking counts squeezes, even if the job minimises seconds. The times of two grasp poses differ by
        less than the error of the estimate, and ranking by time would prefer quick grasp poses that reveal
        little. The search values the best ones in the job's unit.

        All grasp poses are judged by few particles first, the better half by twice as many, and so on,
        until few are left (sequential halving: Karnin, Koren and Somekh, ICML 2013).
        """
        contest = _Contest(belief, placements)
        while contest.waiting:
            contest.squeeze(self.problem.ahead, rng)
            contest.halve(1.0 + self._judge(contest))
        return Options.sorted(contest.placements, contest.squeezes)

    def varied(self, belief: Belief, thin: Belief, options: Options, rng: Generator) -> Options:
        """Adds random variants of the best options in rounds of decreasing spread: a local search.

        Args:
            belief: the belief that open fingers must clear.
            thin: a sample of the belief, on which the variants are judged.
            options: options for the belief.
            rng: source of randomness.

        Returns:
            The options with the variants, the best first.
        """
        for spread in VARIED if self.actions.proposals and belief.touched else ():
            best = options.placements[:VARIED_BEST]
            near = self.free(belief, varied(best, VARIED_BEST, spread, rng))
            if len(near):
                more = self.rank(thin, near, rng)
                options = Options.sorted(*map(np.concatenate, zip(options, more, strict=True)))
        return options

    def unlike(self, belief: Belief, placements: Array, most: int) -> Array:
        """Drops near duplicates from a belief's grasp poses (k, 3), the best first; keeps at most `most`.

        If the job has special placements for the first squeeze (`ActionSet.first`), only equal poses are
        dropped there, since each pose may begin another plan.
        """
        fixed = self.actions.first is not None and not belief.touched
        return np.asarray(placements[unlike(placements, most, 0.0 if fixed else 1.0)])

    def free(self, belief: Belief, placements: Array) -> Array:
        """The grasp poses (k, 3) in the area at which open fingers clear a belief.

        If there are none, those at which the fingers clear all of the belief but the job's `crash_share`.
        """
        placements = self.actions.within(placements)
        free = self._clear(belief, placements, LEAST_CLEARANCE_MM)
        crash_share = self.problem.job.goal.crash_share
        if crash_share > 0.0 and not free.any():
            free = self._clear(belief, placements, 0.0, crash_share)
        return np.asarray(placements[free])

    def _clear(
        self, belief: Belief, placements: Array, least_mm: float, share: float = 0.0
    ) -> BoolArray:
        """Mask (k,) of placements whose fingers clear all but a share of the particles of each hypothesis."""
        clear, mixture = np.ones(len(placements), np.bool_), self.problem.mixture
        for k, rows in by_hypothesis(belief.traits):
            outline, poses = mixture.outlines[k], belief.poses[rows]
            clear &= free_placements(outline, mixture.jaws, poses, placements, least_mm, share)
        return clear

    def _judge(self, contest: _Contest) -> Array:
        """Expected squeezes left (k,) after each option of a contest."""
        costs = self.problem.rule.compiled()
        states, reading = contest.states(bool(self.problem.metric.further)), contest.reading
        together = [slice(k, k + TOGETHER) for k in range(0, len(states), TOGETHER)]
        threads = Threads(self.problem.mixture.workers)
        left = threads.map(lambda some: judged(states[some], reading[some], costs), together)
        return np.concatenate(list(left))


@kernel
def judged(states: Array, reading: IntArray, costs: Costs) -> Array:
    """Partitions the readings of each option into branches; returns the leaf heuristic expected after it.

    Args:
        states: (k, n, m) particles after each of k options.
        reading: (k, n) readings.
        costs: costs of branches and leaves.

    Returns:
        (k,) the expected number of squeezes that are still needed after each option.
    """
    left, n = np.zeros(reading.shape[0]), reading.shape[1]
    for option in range(reading.shape[0]):
        branch = interval_of_each(states[option], reading[option], costs)
        columns, size, _ = by_group(states[option], branch, branch.max() + 1)
        shares = np.zeros((size.shape[0], costs.modes))
        mode_shares(columns, np.cumsum(size), costs.weights, shares)
        for j in range(size.shape[0]):
            ahead = squeezes_left(shares[j].sum() * size[j], size[j], costs.stopping)
            left[option] += size[j] / n * ahead
    return left


def unlike(placements: Array, most: int, distance: float = 1.0) -> list[int]:
    """Indices of grasp poses (k, 3), the best first, without those near an earlier one; at most `most`.

    Args:
        placements: the grasp poses, the best first.
        most: largest number of indices.
        distance: distance up to which two poses are near, in units of `ALIKE_MM` and `ALIKE`; 0: only equal
            poses are near.
    """
    chosen = list[int]()
    for k, placement in enumerate(placements):
        x, y, turn = np.abs(placements[chosen] - placement).T
        apart = np.maximum(np.hypot(x, y) / ALIKE_MM, np.abs(wrap(turn, 2)) / ALIKE)
        if len(chosen) < most and not (apart <= distance).any():
            chosen.append(k)
    return chosen
