"""The candidate squeezes of a belief, simulated once each and ranked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray
from planner.belief.particles import Belief, subsample
from planner.belief.transition import MotionModel, Outcomes
from planner.frames import wrap
from planner.mechanics.clearance import free_placements
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import by_hypothesis
from planner.search.actions import ActionSet
from planner.search.params import Objective, SearchParams
from planner.search.proposals import refined


class Choice(NamedTuple):
    """An action for a belief.

    Attributes:
        placement: (3,) the hand frame to squeeze at, in the world [mm, mm, rad].
        cost_to_go: J of squeezing there.
        gain: in mode ratio over stopping here, selection bias subtracted.
    """

    placement: Array
    cost_to_go: float
    gain: float


class Options(NamedTuple):
    """One belief's options after one squeeze each.

    Attributes:
        placements: (k, 3) of the hand in the world.
        outcomes: k of them.
        cost: (k,) c.
        ratio: (k,) expected mode ratio after it.
        cost_to_go: (k,) J of depth 1.
        rank: (k,) the same less a bonus for beliefs of two modes; less is better.
    """

    placements: Array
    outcomes: list[Outcomes]
    cost: Array
    ratio: Array
    cost_to_go: Array
    rank: Array

    def best(self, most: int) -> list[int]:
        """The most promising options."""
        return [int(k) for k in np.argsort(self.rank, kind="stable")[:most]]

    def joined(self, other: Options) -> Options:
        """These options and others of the same belief."""
        columns = [np.concatenate(pair) for pair in zip(self[2:], other[2:], strict=True)]
        placements = np.concatenate([self.placements, other.placements])
        return Options(placements, self.outcomes + other.outcomes, *columns)


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """Simulates and ranks the candidate squeezes of beliefs.

    Attributes:
        actions: what to choose from.
        mixture: knows the parts and the jaws.
        model: motion and sensor model.
        objective: what the plan is to reach.
        crash_share: share of a belief that may lie under an open finger where no placement clears all of it.
    """

    actions: ActionSet
    mixture: Mixture
    model: MotionModel
    objective: Objective
    crash_share: float = 0.0

    def candidates(self, belief: Belief, about: Belief) -> Array:
        """Placements (k, 3) proposed about a belief, at which the open fingers stay clear of another."""
        return self._free(belief, self.actions.options(about.states, self.objective.metric))

    def shortlisted(
        self, beliefs: list[Belief], options: list[Array], rng: np.random.Generator
    ) -> list[Array]:
        """Of more options (k, 3) than all particles can judge, those that rank best by few particles.

        One round of sequential halving (Karnin, Koren and Somekh, ICML 2013).
        """
        params = self.objective.params
        wide = [i for i, choice in enumerate(options) if len(choice) > params.shortlist]
        few = [subsample(beliefs[i], params.shortlist_particles) for i in wide]
        short = list(options)
        for i, squeezed in zip(wide, self.squeeze(few, [options[i] for i in wide], rng), strict=True):
            short[i] = np.asarray(options[i][sorted(squeezed.best(params.shortlist))])
        return short

    def squeeze(self, beliefs: list[Belief], options: list[Array], rng: np.random.Generator) -> list[Options]:
        """Every option (k, 3) of every belief, squeezed once, in one batch."""
        cases = [(belief, a) for belief, choice in zip(beliefs, options, strict=True) for a in choice]
        outcomes = [Outcomes.of(found, self.objective.rule) for found in self.model.squeeze(cases, rng)]
        result, start = [], 0
        for choice in options:
            result.append(self._judge(choice, outcomes[start : start + len(choice)]))
            start += len(choice)
        return result

    def refined(self, belief: Belief, squeezed: Options) -> Array:
        """Variants (k, 3) of the best placements, where placements may be proposed at all."""
        if not self.actions.proposals:
            return squeezed.placements[:0]
        top = squeezed.placements[squeezed.best(self.objective.params.refined)]
        near = np.concatenate([refined(placement) for placement in top])
        return self._free(belief, self.actions.within(near))

    def gain(self, belief: Belief, squeezed: Options, after: Array) -> Array:
        """What each option gains in mode ratio, selection bias subtracted.

        Args:
            belief: the particles that were squeezed.
            squeezed: its k options.
            after: (k,) mode ratio expected after each, at the end of the look-ahead.
        """
        ratio, params = self.objective.metric.mode(belief.states).ratio, self.objective.params
        bias = [selection_bias(ratio, len(belief), len(o.beliefs), params) for o in squeezed.outcomes]
        return np.asarray(after - ratio - np.array(bias))

    def _judge(self, placements: Array, outcomes: list[Outcomes]) -> Options:
        metric, params = self.objective.metric, self.objective.params
        cost = np.array([self.objective.costs.of(outcome) for outcome in outcomes])
        ratio, cost_to_go, rank = np.zeros(len(cost)), cost.copy(), cost.copy()
        for k, outcome in enumerate(outcomes):
            modes = [metric.main_modes(child.states, metric.modes + 1) for child in outcome.beliefs]
            first = np.array([sum(mode.ratio for mode in found[: metric.modes]) for found in modes])
            further = np.array([sum(mode.ratio for mode in found[metric.modes :]) for found in modes])
            ratio[k] = outcome.probability @ first
            size = outcome.clusters.size
            left = self.objective.rule.estimate.squeezes(first * size, size)
            cost_to_go[k] += float(outcome.probability @ left)
            rank[k] = cost_to_go[k] - params.second_mode * (outcome.probability @ further)
        return Options(placements, outcomes, cost, ratio, cost_to_go, rank)

    def _free(self, belief: Belief, placements: Array) -> Array:
        free = self._clear(belief, placements, self.objective.params.least_clearance_mm)
        if self.crash_share > 0.0 and not free.any():
            free = self._clear(belief, placements, 0.0, self.crash_share)
        return np.asarray(placements[free])

    def _clear(self, belief: Belief, placements: Array, least_mm: float, share: float = 0.0) -> BoolArray:
        """Where the fingers keep clear of all but a share of the particles of each hypothesis."""
        found, outlines, jaws = np.ones(len(placements), np.bool_), self.mixture.outlines, self.mixture.jaws
        for k, rows in by_hypothesis(belief.traits):
            found &= free_placements(outlines[k], jaws, belief.poses[rows], placements, least_mm, share)
        return found


def selection_bias(ratio: float, particles: int, clusters: int, params: SearchParams) -> float:
    """What splitting a belief at random adds to its mode ratio: each cluster's mode is chosen to fit it."""
    return float(params.selection_bias * np.sqrt(clusters * ratio * (1.0 - ratio) / particles))


def distinct(choices: list[Choice], most: int, params: SearchParams) -> list[Choice]:
    """The best choice, and others of about its cost that are not nearly the same squeeze.

    Args:
        choices: the best first.
        most: how many to return at most.
        params: what is alike, and how much more an alternative may cost.
    """
    found: list[Choice] = []
    for choice in choices:
        x, y, turn = np.abs([choice.placement - other.placement for other in found]).reshape(-1, 3).T
        turn = np.abs(wrap(turn, 2))
        near = (np.hypot(x, y) < params.alike_mm) & (turn < np.radians(params.alike_deg))
        if not near.any() and choice.cost_to_go < choices[0].cost_to_go + params.alternative_excess:
            found.append(choice)
    return found[:most]
