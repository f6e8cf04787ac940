"""Closed-loop look-ahead: the next squeeze, chosen knowing that the one after may depend on what it shows.

    J(b, d) = min_a [ c(a) + sum_z P(z | b, a) J(b_z, d - 1) ],    J(b, d) = 0 where r(b) meets the goal,
    J(b, 0) = 1 - exp(-(1 - r(b)) / tau) + 1 - r(b)

J is the number of squeezes still to make, c the cost of one (1, and what else it costs in units of that), r
the mode ratio. Where the look-ahead ends J is a guess: a belief that does not meet the goal needs one squeeze
more, however little it lacks, and a second one the more likely the more it lacks. A tree whose beliefs are
all nearly there is worth less than one with most of them done; r alone, which the paper climbs, does not see
that.

Observations partition the particles, so branching on them costs no more roll-outs than the paper's open-loop
search of the same depth. Actions are widened progressively: all of them are squeezed once (hundreds of them
by few particles at first), and only the most promising are followed further.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Metric
from planner.belief.particles import subsample
from planner.belief.transition import Costs, MotionModel, Outcomes
from planner.mechanics.clearance import free_placements
from planner.mechanics.simulator import Simulator
from planner.search.actions import ActionSet
from planner.search.options import Choice, Options, joined, selection_bias, squeezes_left, unlike
from planner.search.proposals import refined

LEAST_CLEARANCE_MM = 0.5
"""Open fingers are never planned nearer to a believed part than this."""
FOLLOWED = (4, 4, 4)
"""How many actions are followed beyond their first squeeze: at the node itself, one squeeze on, and so on."""
SECOND_MODE = 0.25
"""What explaining a belief by two poses counts against explaining it by one, where actions are ranked."""
NEARLY = 0.5
"""Squeezes still to make after one of the options, below which none is followed further."""
LEAST_PROGRESS = 0.001
"""Gain in mode ratio below which no squeeze is planned."""
LEAST_AT_STAKE = 0.0003
"""Share of all parts that a belief must lack for a deeper look ahead."""
LOST = 10.0
"""Squeezes that a belief is worth which no squeeze gets nearer the goal, at the end of the look-ahead."""
SHRINK = 1.0
"""Particles that each child belief is taken to have wrong: thin ones look purer than they are."""
WIDE = 32
"""Options of a belief that are judged by all its particles; of more, those that few speak for."""
SKETCH = 50
"""Particles that speak for an option first."""
REFINED = 2
"""How many of the best placements are varied."""
HEAVY = 0.2
"""Share of all parts from which a belief is looked ahead with all the particles allowed."""
FEWEST = 0.25
"""Share of those particles that the lightest belief keeps."""
OUTSIDE = 20
"""Particles outside the mode that it takes to see whether a squeeze tells them from the rest."""
CONTENDERS = 6
"""Squeezes of which that is asked."""


class _Followed(NamedTuple):
    """One belief's options after all the squeezes looked ahead; J is infinite where one was not followed."""

    cost_to_go: Array
    ratio: Array


@dataclass(frozen=True, slots=True, eq=False)
class LookAhead:
    """The search for one node's action.

    Attributes:
        actions: what to choose from.
        simulator: knows the part and the jaws.
        model: motion and sensor model.
        metric: the goal.
        confidence: mode ratio at which a belief needs no further squeeze.
        depth: squeezes to look ahead.
        costs: c.
        particles: size of the belief to search with.
        crash_share: share of a belief that may lie under an open finger where no placement clears all of it.
    """

    actions: ActionSet
    simulator: Simulator
    model: MotionModel
    metric: Metric
    confidence: float
    depth: int
    costs: Costs
    particles: int
    crash_share: float = 0.0

    def choose(
        self, belief: Array, rng: np.random.Generator, most: int = 1, share: float = 1.0
    ) -> list[Choice]:
        """The placements to squeeze at, the most promising first.

        Where nothing gains at the stated depth one squeeze more is looked ahead if that matters: a belief of
        several modes may need two before any progress shows. Where that does not help, what the belief
        lacks may be too little for so few particles to show.

        Args:
            belief: (n, 3) particles in the world, or (n, 4) with friction.
            rng: source of randomness.
            most: how many at most, each unlike those before it.
            share: of all parts that come to this belief: the fewer do, the less is spent on it.

        Returns:
            None at all where no action is free of collision or gains anything.
        """
        for depth, particles in self._efforts(belief, share):
            options = self._options(belief, subsample(belief, particles), depth, rng)
            gaining = sorted((k for k in options if k.gain > LEAST_PROGRESS), key=lambda k: k.cost_to_go)
            if gaining and gaining[0].cost_to_go < 1.0 + NEARLY:
                gaining = self._checked(belief, particles, gaining, rng)
            if gaining:
                return unlike(gaining, most)
        return []

    def _efforts(self, belief: Array, share: float) -> Iterator[tuple[int, int]]:
        """Squeezes to look ahead and particles to do it with, one after the other until something gains."""
        few = round(self.particles * max(FEWEST, min(1.0, share / HEAVY) ** 0.5))
        yield self.depth, few
        if share * (1.0 - self.metric.mode(belief).ratio) > LEAST_AT_STAKE:
            yield self.depth + 1, few
        if self._telling(belief) > few:
            yield self.depth, self._telling(belief)

    def _telling(self, belief: Array) -> int:
        """How many particles it takes to see those outside the mode."""
        outside = 1.0 - self.metric.mode(belief).ratio
        return min(len(belief), round(OUTSIDE / max(outside, LEAST_PROGRESS)))

    def _checked(
        self, belief: Array, particles: int, choices: list[Choice], rng: np.random.Generator
    ) -> list[Choice]:
        """Choices that seem to be the last squeeze needed, judged again by what few particles cannot show."""
        if self._telling(belief) <= particles:
            return choices
        thin = subsample(belief, self._telling(belief))
        (squeezed,) = self._squeeze([thin], [np.array([k.placement for k in choices[:CONTENDERS]])], rng)
        gain = self._gain(thin, squeezed, squeezed.ratio)
        found = zip(squeezed.placements, squeezed.cost_to_go, gain, strict=True)
        return sorted(
            (Choice(a, float(j), float(g)) for a, j, g in found if g > LEAST_PROGRESS),
            key=lambda k: k.cost_to_go,
        )

    def _gain(self, belief: Array, squeezed: Options, after: Array) -> Array:
        """What each option gains in mode ratio, beyond selection bias."""
        ratio = self.metric.mode(belief).ratio
        chance = [selection_bias(ratio, len(belief), len(outcome.beliefs)) for outcome in squeezed.outcomes]
        return np.asarray(after - ratio - np.array(chance))

    def _options(self, belief: Array, thin: Array, depth: int, rng: np.random.Generator) -> list[Choice]:
        """All that may be done, the best of it varied a little if placements may be proposed."""
        options = self._free(belief, self.actions.options(thin, self.metric))
        if not len(options):
            return []
        (squeezed,) = self._squeeze([thin], self._shortlist([thin], [options], rng), rng)
        if self.actions.proposals is not None:
            top = squeezed.placements[squeezed.best(REFINED)]
            near = self.actions.within(np.concatenate([refined(placement) for placement in top]))
            near = self._free(belief, near)
            if len(near):
                squeezed = joined(squeezed, self._squeeze([thin], [near], rng)[0])
        (followed,) = self._follow([squeezed], depth, 0, rng)
        gain = self._gain(thin, squeezed, np.maximum(followed.ratio, squeezed.ratio))
        found = zip(squeezed.placements, followed.cost_to_go, gain, strict=True)
        return [
            Choice(a, float(cost_to_go), float(more))
            for a, cost_to_go, more in found
            if np.isfinite(cost_to_go)
        ]

    def _values(
        self, beliefs: list[Array], depth: int, level: int, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """J of each belief, `depth` squeezes to go, and the mode ratio it then has."""
        ratio = np.array([self.metric.mode(belief).ratio for belief in beliefs])
        short = np.flatnonzero(ratio < self.confidence)
        ratio = ratio - SHRINK / np.array([len(belief) for belief in beliefs])
        cost_to_go = squeezes_left(ratio)
        if depth == 0:
            return cost_to_go, ratio
        options = [self._free(beliefs[i], self.actions.options(beliefs[i], self.metric)) for i in short]
        movable = [(int(i), choice) for i, choice in zip(short, options, strict=True) if len(choice)]
        before = ratio.copy()
        moved = [beliefs[i] for i, _ in movable]
        squeezed = self._squeeze(moved, self._shortlist(moved, [choice for _, choice in movable], rng), rng)
        for (i, _), found in zip(movable, self._follow(squeezed, depth, level, rng), strict=True):
            best = int(np.argmin(found.cost_to_go))
            cost_to_go[i], ratio[i] = found.cost_to_go[best], max(ratio[i], found.ratio[best])
        lost = short[ratio[short] < before[short] + LEAST_PROGRESS]
        cost_to_go[lost] += LOST * (1.0 - ratio[lost])
        return cost_to_go, ratio

    def _shortlist(self, beliefs: list[Array], options: list[Array], rng: np.random.Generator) -> list[Array]:
        """Of more options than all particles can judge, those that few particles say most for.

        One round of sequential halving (Karnin, Koren and Somekh, ICML 2013).
        """
        wide = [i for i, choice in enumerate(options) if len(choice) > WIDE]
        few = [subsample(beliefs[i], SKETCH) for i in wide]
        short = list(options)
        for i, squeezed in zip(wide, self._squeeze(few, [options[i] for i in wide], rng), strict=True):
            short[i] = np.asarray(options[i][sorted(squeezed.best(WIDE))])
        return short

    def _squeeze(self, beliefs: list[Array], options: list[Array], rng: np.random.Generator) -> list[Options]:
        """Every option of every belief, once, in one batch."""
        cases = [(belief, a) for belief, choice in zip(beliefs, options, strict=True) for a in choice]
        outcomes = self.model.squeeze(cases, rng)
        result, start = [], 0
        for choice in options:
            result.append(self._judge(choice, outcomes[start : start + len(choice)]))
            start += len(choice)
        return result

    def _judge(self, placements: Array, outcomes: list[Outcomes]) -> Options:
        """What one squeeze each comes to."""
        cost = np.array([self.costs.of(outcome) for outcome in outcomes])
        ratio, cost_to_go, rank = np.zeros(len(cost)), cost.copy(), cost.copy()
        for k, outcome in enumerate(outcomes):
            few = np.array([SHRINK / len(child) for child in outcome.beliefs])
            modes = [self.metric.main_modes(child, self.metric.modes + 1) for child in outcome.beliefs]
            first = np.array([sum(mode.ratio for mode in found[: self.metric.modes]) for found in modes])
            further = np.array([sum(mode.ratio for mode in found[self.metric.modes :]) for found in modes])
            ratio[k] = outcome.probability @ first
            cost_to_go[k] += outcome.probability @ squeezes_left(first - few)
            rank[k] = cost_to_go[k] - SECOND_MODE * (outcome.probability @ further)
        return Options(placements, outcomes, cost, ratio, cost_to_go, rank)

    def _follow(
        self, squeezed: list[Options], depth: int, level: int, rng: np.random.Generator
    ) -> list[_Followed]:
        """J of every option, the promising ones followed for the squeezes that remain."""
        found = [_Followed(options.cost_to_go.copy(), options.ratio.copy()) for options in squeezed]
        if depth == 1:
            return found
        width = FOLLOWED[min(level, len(FOLLOWED) - 1)]
        open_ones = [
            i for i, options in enumerate(squeezed) if (options.cost_to_go - options.cost).min() > NEARLY
        ]
        chosen = [(i, k) for i in open_ones for k in squeezed[i].best(width)]
        children = [child for i, k in chosen for child in squeezed[i].outcomes[k].beliefs]
        cost_to_go, ratio = self._values(children, depth - 1, level + 1, rng)
        for i in open_ones:
            found[i].cost_to_go[:] = np.inf
        start = 0
        for i, k in chosen:
            outcome = squeezed[i].outcomes[k]
            part = slice(start, start + len(outcome.beliefs))
            found[i].cost_to_go[k] = squeezed[i].cost[k] + outcome.probability @ cost_to_go[part]
            found[i].ratio[k] = outcome.probability @ ratio[part]
            start = part.stop
        return found

    def _free(self, belief: Array, placements: Array) -> Array:
        """Those of the placements at which the open fingers stay clear of the belief."""
        part, jaws = self.simulator.outline, self.simulator.jaws
        free = free_placements(part, jaws, belief, placements, LEAST_CLEARANCE_MM)
        if self.crash_share > 0.0 and not free.any():
            free = free_placements(part, jaws, belief, placements, 0.0, self.crash_share)
        return np.asarray(placements[free])
