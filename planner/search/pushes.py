"""Pushes proposed for a belief: the hand comes down clear of all particles and goes straight through them.

A push yields no reading. It may reduce the uncertainty, and bring parts to where open fingers clear them:
after a push past every particle, all of them lie at the pusher's face.
"""

import math
from dataclasses import replace
from itertools import product
from operator import itemgetter
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.random import Generator

from planner.arrays import Array
from planner.belief.costs import Hand
from planner.belief.particles import Belief, subsample
from planner.belief.transition import Push
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import by_hypothesis
from planner.part.outline import reach
from planner.problem import Problem
from planner.search.actions import turnable
from planner.search.ranking import Ranking

OPENINGS = (0.0, 0.25, 0.5)
"""Openings of the jaws while they push, as shares of the full opening."""
BESIDE_MM = 2.0  # clearance between the pusher and the nearest particle where it comes down
BEYOND_MM = 2.0  # distance past the near edge of the farthest part
FARTHER = (0.0, 0.7)
"""Further distances, in reaches of the part: parts turn until a side lies at both fingers."""
MOST = 2  # most pushes before one squeeze
JUDGED = 200  # particles for a first ranking of pushes
KEPT = 3  # best single pushes, and pairs of them, that are continued
FINALISTS = 2  # sequences that are judged as thoroughly as a squeeze without pushes
LEAST_SHARE = 0.02  # probability of a node from which pushes are tried
ROUND_MM = 0.01  # margin to the area's edge, since tables hold whole micrometres
SPREAD = 1e3  # cost of a belief that no grasp pose clears, per millimetre of the belief's spread

Pushes: TypeAlias = tuple[Push, ...]


class Pushed(NamedTuple):
    """Pushes, and the belief after them."""

    pushes: Pushes
    belief: Belief


class Pusher:
    """Proposes pushes and chooses among them."""

    def __init__(self, problem: Problem) -> None:
        # Pushes depend more on the closing step than squeezes do: theirs is that of the final evaluation.
        job, mixture = problem.job, Mixture.of_job(problem.job, problem.mixture.workers)
        self.model, self.costs = replace(problem.model, simulator=mixture), problem.costs
        self.jaws, self._outlines = mixture.jaws, mixture.outlines
        self._area, self._turnable = np.array(job.cell.work_area_mm), turnable(job)

    def options(self, belief: Belief) -> list[Push]:
        """Candidate pushes: each starts in front of all particles and ends past the near edge of each one."""
        result, farthest = list[Push](), max(map(reach, self._outlines))
        for angle in self._angles(belief):
            c, s = np.cos(angle), np.sin(angle)
            along, across = np.array([[c, s], [-s, c]])
            begins, middle = self._begins(belief, along), belief.poses[:, :2].mean(axis=0) @ across
            start, beyond = float(begins.min()) - BESIDE_MM, float(begins.max()) + BEYOND_MM
            place = (start - 0.5 * self.jaws.length_mm) * along + middle * across
            for opening, farther in product(OPENINGS, FARTHER):
                way_mm = beyond + farther * farthest - start
                opening_mm = opening * self.jaws.opening_mm
                result.append(Push(np.array([*place, angle]), opening_mm, way_mm))
        return [push for push in result if self._within(push)]

    def best(
        self, belief: Belief, hand: Hand | None, ranking: Ranking, rng: Generator
    ) -> list[Pushes]:
        """The most promising sequences of one or two pushes, judged by few particles and one squeeze each.

        Returns:
            At most `FINALISTS` sequences; after each of them, open fingers clear the belief at some grasp
            pose.
        """
        judged, begun = list[tuple[float, Pushes]](), [Pushed((), subsample(belief, JUDGED))]
        for _ in range(MOST):
            tried = [
                Pushed((*before, push), self.model.push(thin, push, rng))
                for before, thin in begun
                for push in self.options(thin if before else belief)
            ]
            costs = self._costs(tried, hand, ranking, rng)
            order = np.argsort(costs, kind="stable")[:KEPT]
            judged += [(float(costs[k]), tried[k].pushes) for k in order]
            begun = [tried[k] for k in order]
        finalists = list[Pushes]()
        for _, pushes in sorted(judged, key=itemgetter(0)):
            if len(finalists) < FINALISTS:
                pushed = self._from_beside_all(belief, pushes, rng)
                if pushed and len(ranking.candidates(pushed.belief, pushed.belief)):
                    finalists.append(pushed.pushes)
        return finalists

    def pushed(self, belief: Belief, pushes: Pushes, rng: Generator) -> Belief:
        """The belief after pushes, which are simulated twice for each particle.

        Two copies show how much pushed parts scatter; open fingers have to clear all copies.
        """
        belief = Belief.joined([belief, belief])
        for push in pushes:
            belief = self.model.push(belief, push, rng)
        return belief

    def _costs(
        self, tried: list[Pushed], hand: Hand | None, ranking: Ranking, rng: Generator
    ) -> Array:
        """Cost-to-go (k,) of each pushed belief at its best grasp pose, with the price of its pushes.

        Where no grasp pose clears a belief, the cost grows with its spread.
        """
        costs = np.array([SPREAD * each.belief.poses[:, :2].std(axis=0).max() for each in tried])
        for k, (pushes, belief) in enumerate(tried):
            options = ranking.rank(belief, ranking.candidates(belief, belief), rng)
            if len(options.squeezes):
                costs[k] = self.costs.pushes(hand, pushes)[0] + options.squeezes[0]
        return costs

    def _from_beside_all(self, belief: Belief, pushes: Pushes, rng: Generator) -> Pushed | None:
        """Moves the start of each push back until the fingers clear the belief, and simulates the pushes.

        Returns the moved pushes and the belief after them; None if a push leaves the area.
        """
        beside = list[Push]()
        for push in pushes:
            beside.append(self._from_beside(push, belief))
            if not self._within(beside[-1]):
                return None
            belief = self.model.push(belief, beside[-1], rng)
        return Pushed(tuple(beside), belief)

    def _from_beside(self, push: Push, belief: Belief) -> Push:
        """A push with the same end, but started far enough back to clear a whole belief."""
        along = np.array([np.cos(push.start[2]), np.sin(push.start[2])])
        face = float(push.start[:2] @ along) + 0.5 * self.jaws.length_mm
        back = max(0.0, face + BESIDE_MM - float(self._begins(belief, along).min()))
        start = push.start - back * np.array([*along, 0.0])
        return push._replace(start=start, way_mm=push.way_mm + back)

    def _within(self, push: Push) -> bool:
        """Whether a push begins and ends in the area."""
        along = [np.cos(push.start[2]), np.sin(push.start[2])]
        ends = push.start[:2] + np.outer([0.0, push.way_mm], along)
        return bool(np.all((ends >= self._area[0] + ROUND_MM) & (ends <= self._area[1] - ROUND_MM)))

    def _angles(self, belief: Belief) -> list[float]:
        """Directions of pushes: both ways along and across the spread of a belief.

        An untouched belief gets only one direction if a turn of the whole plan changes nothing.
        """
        if self._turnable and not belief.touched:
            return [0.0]
        x, y = (belief.poses[:, :2] - belief.poses[:, :2].mean(axis=0)).T
        angle = 0.5 * math.atan2(2.0 * float((x * y).mean()), float((x * x - y * y).mean()))
        return [angle + quarter * 0.5 * np.pi for quarter in (-2, -1, 0, 1)]

    def _begins(self, belief: Belief, along: Array) -> Array:
        """Coordinate (n,) of the near edge of each part along a direction (2,) [mm]."""
        begins = np.empty(len(belief))
        for k, rows in by_hypothesis(belief.traits):
            x, y, theta = belief.poses[rows].T
            c, s = np.cos(theta), np.sin(theta)
            turned = np.stack([c * along[0] + s * along[1], c * along[1] - s * along[0]])
            begins[rows] = x * along[0] + y * along[1] + (self._outlines[k] @ turned).min(axis=0)
        return begins
