"""The candidate squeezes of a belief, simulated once each and ranked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray
from planner.belief.particles import Belief
from planner.belief.transition import MotionModel, Outcomes, Squeezed
from planner.frames import wrap
from planner.mechanics.clearance import free_placements
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import by_hypothesis
from planner.search.actions import ActionSet
from planner.search.params import Objective, SearchParams
from planner.search.proposals import refined

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples, cut to their fractions, fill an interval evenly


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


@dataclass(slots=True, eq=False)
class _Contest:
    """The options of one belief while they are halved."""

    belief: Belief
    placements: Array  # (k, 3) of those still in it
    stop: int  # how many of the particles will have squeezed after this round
    start: int = 0  # how many have squeezed
    squeezed: list[Squeezed] = field(default_factory=list)  # k, by all particles so far
    options: Options = field(init=False)  # as judged last

    @classmethod
    def of(cls, belief: Belief, placements: Array, params: SearchParams) -> _Contest:
        """The first round: fewer particles the more options there are, spread evenly through the belief."""
        few = len(belief)
        if len(placements) > params.finalists:
            few = min(few, max(params.first_particles, round(params.first_share * few)))
            belief = belief[np.argsort(np.arange(len(belief)) * GOLDEN % 1.0, kind="stable")]
        return cls(belief, placements, few)

    @property
    def waiting(self) -> bool:
        """Whether particles are left to squeeze with."""
        return self.start < len(self.belief)

    @property
    def next(self) -> Belief:
        """The particles of this round."""
        return self.belief[self.start : self.stop]

    def add(self, squeezed: list[Squeezed]) -> None:
        """What this round's particles came to, for each option."""
        before = zip(self.squeezed, squeezed, strict=True) if self.squeezed else ((new,) for new in squeezed)
        self.squeezed, self.start = [Squeezed.joined(parts) for parts in before], self.stop

    def halve(self, options: Options, params: SearchParams) -> None:
        """Drops the worse options, unless all particles have judged them."""
        self.options = options
        if self.waiting:
            kept = sorted(options.best(max(params.finalists, -(-len(self.placements) // 2))))
            self.placements, self.squeezed = self.placements[kept], [self.squeezed[k] for k in kept]
            last = len(kept) <= params.finalists
            self.stop = len(self.belief) if last else min(len(self.belief), 2 * self.stop)


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

    def candidates(self, belief: Belief, about: Belief, *, wide: bool = False) -> Array:
        """Placements (k, 3) proposed about a belief, at which the open fingers stay clear of another."""
        return self._free(belief, self.actions.options(about.states, self.objective.metric, wide=wide))

    def squeeze(self, beliefs: list[Belief], options: list[Array], rng: np.random.Generator) -> list[Options]:
        """The best of every belief's options (k, 3), each squeezed by all its particles.

        All options are squeezed by few particles first, the better half by twice as many, and so on, until
        few options are left (sequential halving: Karnin, Koren and Somekh, ICML 2013).
        """
        params = self.objective.params
        contests = [
            _Contest.of(belief, choice, params) for belief, choice in zip(beliefs, options, strict=True)
        ]
        while waiting := [contest for contest in contests if contest.waiting]:
            cases = [(contest.next, a) for contest in waiting for a in contest.placements]
            squeezed = iter(self.model.squeeze(cases, rng))
            for contest in waiting:
                contest.add([next(squeezed) for _ in contest.placements])
                outcomes = [Outcomes.of(found, self.objective.rule) for found in contest.squeezed]
                contest.halve(self._judge(contest.placements, outcomes), params)
        return [contest.options for contest in contests]

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
        metric, params = self.objective.metric, self.objective.params
        ratio = float(metric.shares([belief.states], metric.modes).sum())  # as those after it are found
        bias = [selection_bias(ratio, len(belief), len(o.beliefs), params) for o in squeezed.outcomes]
        return np.asarray(after - ratio - np.array(bias))

    def _judge(self, placements: Array, outcomes: list[Outcomes]) -> Options:
        metric, params = self.objective.metric, self.objective.params
        cost = np.array([self.objective.costs.of(outcome) for outcome in outcomes])
        ratio, cost_to_go, rank = np.zeros(len(cost)), cost.copy(), cost.copy()
        children = [child.states for outcome in outcomes for child in outcome.beliefs]
        modes = metric.shares(children, metric.modes + 1)
        first, further = modes[:, : metric.modes].sum(axis=1), modes[:, metric.modes :].sum(axis=1)
        start = 0
        for k, outcome in enumerate(outcomes):
            size = outcome.clusters.size
            part = slice(start, start + len(size))
            start = part.stop
            ratio[k] = outcome.probability @ first[part]
            left = self.objective.rule.estimate.squeezes(first[part] * size, size)
            cost_to_go[k] += float(outcome.probability @ left)
            rank[k] = cost_to_go[k] - params.second_mode * (outcome.probability @ further[part])
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
