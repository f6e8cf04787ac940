"""Closed-loop look-ahead: the next squeeze, chosen knowing that the one after may depend on what it shows.

    J(b, d) = min_a [ c(a) + sum_z P(z | b, a) J(b_z, d - 1) ],    J(b, d) = 0 where r(b) meets the goal,
    J(b, 0) of `planner.belief.partition.Estimate`

J is the expected number of squeezes to go, c the cost of one (1 plus its other costs in units of that), r
the mode ratio. J(b, 0) is a heuristic: a belief that misses the goal needs one squeeze more, however little
is missing, and a second one the more likely the more is missing. Maximising the expected r, as the paper
does, would prefer many beliefs that all just miss the goal to most of them meeting it.

Observations partition the particles, so branching on them costs no more roll-outs than the paper's open-loop
search of the same depth. Actions are widened progressively: all of them are squeezed once (hundreds of them
with few particles at first), and only the most promising are followed further.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import Belief, subsample
from planner.search.params import Objective
from planner.search.ranking import Choice, Options, Ranking, distinct


class _Followed(NamedTuple):
    """One belief's options after all the squeezes looked ahead; J is infinite where one was not followed."""

    cost_to_go: Array
    ratio: Array


@dataclass(frozen=True, slots=True, eq=False)
class LookAhead:
    """The search for one node's action.

    Attributes:
        ranking: simulates and ranks the squeezes of a belief.
        depth: squeezes to look ahead.
        particles: size of the belief to search with.
    """

    ranking: Ranking
    depth: int
    particles: int

    @property
    def objective(self) -> Objective:
        """What the plan is to reach."""
        return self.ranking.objective

    def choose(
        self, belief: Belief, rng: np.random.Generator, most: int = 1, share: float = 1.0, vain: int = 0
    ) -> list[Choice]:
        """The placements to squeeze at, the most promising first.

        Where nothing gains at the stated depth, one squeeze more is looked ahead if enough parts come here:
        a belief of several modes may need two before any progress shows. Then more particles are tried: the
        mass outside the mode may be too small for few of them to show; at last all the hands about the part.
        So it goes where a belief lies at few poses and the best action still costs much.

        Args:
            belief: the node's.
            rng: source of randomness.
            most: how many at most, each unlike those before it.
            share: of all parts that come to this belief: the fewer do, the less is spent on it.
            vain: squeezes just before that gained nothing: as many of the lesser efforts are left out.

        Returns:
            An empty list where no action is free of collision or gains anything.
        """
        params = self.objective.params
        efforts, found = list(self._efforts(belief, share)), list[Choice]()
        enough = self._enough(belief)
        for depth, particles, scattered in efforts[min(vain, len(efforts) - 1) :]:
            options = self._options(belief, subsample(belief, particles), depth, scattered, rng)
            gaining = sorted((k for k in options if k.gain > params.least_gain), key=attrgetter("cost_to_go"))
            if gaining and gaining[0].cost_to_go < 1.0 + params.nearly_done:
                gaining = self._rescored(belief, particles, gaining, rng)
            found = sorted(found + gaining, key=attrgetter("cost_to_go"))
            if found and found[0].cost_to_go < enough:
                break
        if not found:
            return []
        excess = params.alternative_excess if belief.touched else params.first_excess
        placements = np.array([k.placement for k in found])
        compared = self.ranking.actions.compared(placements, belief.touched)
        return distinct(found, compared, most, excess, params)

    def _enough(self, belief: Belief) -> float:
        """J below which an action is good enough; any is, but of beliefs at few poses.

        And where there are no hands but those that every effort tries.
        """
        metric, params = self.objective.metric, self.objective.params
        if self.depth == 1 or not self.ranking.actions.proposals:
            return np.inf
        thin = subsample(belief, self.particles)
        shares, size = metric.shares([thin.states], metric.modes + 1), np.array([len(thin)])
        if shares.sum() < params.few_poses:
            return np.inf
        hits = shares[:, : metric.modes].sum(axis=1) * size
        return params.hard + float(self.objective.rule.estimate.squeezes(hits, size)[0])

    def _efforts(self, belief: Belief, share: float) -> Iterator[tuple[int, int, int]]:
        """Squeezes to look ahead, particles to do it with, and how many hands about the part are tried."""
        params = self.objective.params
        effort = max(params.least_effort, min(1.0, share / params.full_effort_share) ** 0.5)
        few, hands = round(self.particles * effort), round(params.scattered * effort)
        needed = self._particles_needed(belief)
        yield self.depth, few, hands
        if share > params.deeper_share:
            yield self.depth + 1, few, hands
        if needed > few:
            yield self.depth, needed, hands
        if share > params.thorough_share:
            yield self.depth, max(few, needed), params.scattered

    def _particles_needed(self, belief: Belief) -> int:
        """How many particles it takes to see those outside the mode."""
        outside = 1.0 - self.objective.metric.mode(belief.states).ratio
        params = self.objective.params
        return min(len(belief), round(params.outside_particles / max(outside, params.least_gain)))

    def _rescored(
        self, belief: Belief, particles: int, choices: list[Choice], rng: np.random.Generator
    ) -> list[Choice]:
        """Choices that seem to be the last squeeze needed, scored again with enough particles to tell."""
        if self._particles_needed(belief) <= particles:
            return choices
        params = self.objective.params
        thin = subsample(belief, self._particles_needed(belief))
        placements = np.array([k.placement for k in choices[: params.rescored]])
        (squeezed,) = self.ranking.squeeze([thin], [placements], rng)
        found = self._choices(thin, squeezed, _Followed(squeezed.cost_to_go, squeezed.ratio))
        return sorted((k for k in found if k.gain > params.least_gain), key=attrgetter("cost_to_go"))

    def _options(
        self, belief: Belief, thin: Belief, depth: int, scattered: int, rng: np.random.Generator
    ) -> list[Choice]:
        """Placements in two groups, the best of each and variants of these looked ahead.

        Hands scattered about the part promise more after one squeeze than those along its sides, which may
        leave less to do after two: neither group takes the other's place among those that are followed.
        """
        params, choices = self.objective.params, list[Choice]()
        groups = [self.ranking.candidates(belief, thin), self.ranking.scattered(belief, thin, scattered)]
        groups = [options for options in groups if len(options)]
        few = max(1, params.varied * scattered // params.scattered)
        squeezed = self.ranking.squeeze([thin] * len(groups), groups, rng)
        squeezed = [self.ranking.varied(belief, thin, options, few, rng) for options in squeezed]
        for options, followed in zip(squeezed, self._follow(squeezed, depth, rng), strict=True):
            choices += self._choices(thin, options, followed)
        return choices

    def _choices(self, belief: Belief, squeezed: Options, followed: _Followed) -> list[Choice]:
        """The options that were followed."""
        gain = self.ranking.gain(belief, squeezed, np.maximum(followed.ratio, squeezed.ratio))
        found = zip(squeezed.placements, followed.cost_to_go, gain, strict=True)
        return [Choice(a, float(j), float(more)) for a, j, more in found if np.isfinite(j)]

    def _values(self, beliefs: list[Belief], depth: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """J of each belief, `depth` squeezes to go, and the mode ratio it then has."""
        params = self.objective.params
        metric = self.objective.metric
        ratio = metric.shares([belief.states for belief in beliefs], metric.modes).sum(axis=1)
        short = np.flatnonzero(ratio < self.objective.confidence)
        size = np.array([len(belief) for belief in beliefs])
        cost_to_go = self.objective.rule.estimate.squeezes(ratio * size, size)
        ratio = ratio - params.shrinkage / size
        if depth == 0:
            return cost_to_go, ratio
        options = [self.ranking.candidates(beliefs[i], beliefs[i]) for i in short]
        movable = [(int(i), choice) for i, choice in zip(short, options, strict=True) if len(choice)]
        before = ratio.copy()
        moved, choices = [beliefs[i] for i, _ in movable], [choice for _, choice in movable]
        squeezed = self.ranking.squeeze(moved, choices, rng)
        for (i, _), found in zip(movable, self._follow(squeezed, depth, rng), strict=True):
            best = int(np.argmin(found.cost_to_go))
            cost_to_go[i], ratio[i] = found.cost_to_go[best], max(ratio[i], found.ratio[best])
        stuck = short[ratio[short] < before[short] + params.least_gain]
        cost_to_go[stuck] += params.dead_end * (1.0 - ratio[stuck])
        return cost_to_go, ratio

    def _follow(self, squeezed: list[Options], depth: int, rng: np.random.Generator) -> list[_Followed]:
        """J of every option, the promising ones followed for the squeezes that remain."""
        found = [_Followed(options.cost_to_go.copy(), options.ratio.copy()) for options in squeezed]
        if depth == 1:
            return found
        params = self.objective.params
        open_ones = [i for i, o in enumerate(squeezed) if (o.cost_to_go - o.cost).min() > params.nearly_done]
        chosen = [(i, k) for i in open_ones for k in squeezed[i].unlike(params.followed, params)]
        outcomes = [self.ranking.outcomes(squeezed[i].squeezed[k]) for i, k in chosen]
        children = [child for outcome in outcomes for child in outcome.beliefs]
        cost_to_go, ratio = self._values(children, depth - 1, rng)
        for i in open_ones:
            found[i].cost_to_go[:] = np.inf
        start = 0
        for (i, k), outcome in zip(chosen, outcomes, strict=True):
            part = slice(start, start + len(outcome.beliefs))
            found[i].cost_to_go[k] = squeezed[i].cost[k] + outcome.probability @ cost_to_go[part]
            found[i].ratio[k] = outcome.probability @ ratio[part]
            start = part.stop
        return found
