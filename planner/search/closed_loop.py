"""Closed-loop look-ahead: the next squeeze, chosen knowing that the one after may depend on what it shows.

    V(b, d) = max( r(b), max_a [ -c(a) + sum_z P(z | b, a) V(b_z, d - 1) ] ),   V(b, 0) = r(b)

with r the mode ratio and c the cost of a squeeze. Observations partition the particles, so branching on them
costs no more roll-outs than the paper's open-loop search of the same depth. Actions are widened
progressively: all of them are squeezed once, and only the most promising are followed further.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief import subsample
from planner.goal import Metric
from planner.mechanics.simulator import Simulator
from planner.search.actions import ActionSet, free_placements, least_clearance
from planner.search.costs import Costs
from planner.search.outcomes import MotionModel, Outcomes
from planner.search.proposals import refined

LEAST_CLEARANCE_MM = 0.5
"""Open fingers are never planned nearer to a believed part than this."""
FOLLOWED = (8, 6, 4)
"""How many actions are followed beyond their first squeeze: at the node itself, one squeeze on, and so on."""
SECOND_MODE = 0.25
"""What explaining a belief by two poses counts against explaining it by one, where actions are ranked."""
UNSETTLED = 0.015
"""What the fixed placements may leave open before others are proposed."""
LEAST_PROGRESS = 0.001
"""Gain in mode ratio, the cost of one squeeze not counted, below which none is planned."""
SHRINK = 1.0
"""Particles that each child belief is taken to have wrong: thin ones look purer than they are."""
REFINED = 2
"""How many of the best placements are varied."""


class Choice(NamedTuple):
    """The action chosen for a belief.

    Attributes:
        placement: (3,) the hand frame in the world.
        value: V of squeezing there.
        gain: what that is more than stopping here, the cost of one squeeze not counted.
    """

    placement: Array
    value: float
    gain: float


class _Squeezed(NamedTuple):
    """One belief's options after one squeeze each."""

    placements: Array
    outcomes: list[Outcomes]
    cost: Array
    progress: Array  # expected mode ratio after it
    worth: Array  # of one squeeze, cost deducted
    rank: Array


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

    def clearance(self, belief: Array, placement: Array) -> float:
        """Least distance between the open fingers at a placement and the believed part [mm]."""
        return least_clearance(self.simulator.outline, self.simulator.jaws, belief, placement)

    def choose(self, belief: Array, rng: np.random.Generator) -> Choice | None:
        """The placement to squeeze at.

        The cost decides which action is best, not whether to go on: a belief that does not meet the goal yet
        is squeezed as long as that gets it nearer. The fixed placements are looked at first, and those about
        the belief only where these do not settle it. Where nothing gains at the stated depth one squeeze more
        is looked ahead: a belief of several modes may need two before any progress shows.

        Args:
            belief: (n, 3) particles in the world.
            rng: source of randomness.

        Returns:
            None where no action is free of collision or gains anything.
        """
        found = []
        for look_ahead, depth in self._stages():
            choice = look_ahead._best(belief, depth, rng)
            if choice is not None and choice.gain > LEAST_PROGRESS:
                found.append(choice)
                settled = self.confidence - depth * self.costs.squeeze - UNSETTLED
                if look_ahead is self or choice.value >= settled:
                    break
        return max(found, key=lambda choice: choice.value, default=None)

    def _stages(self) -> list[tuple[LookAhead, int]]:
        """Searches to try one after the other, with their depth."""
        thorough = [(self, self.depth), (self, self.depth + 1)]
        if self.actions.proposals is None:
            return thorough
        return [(replace(self, actions=replace(self.actions, proposals=None)), self.depth), *thorough]

    def _best(self, belief: Array, depth: int, rng: np.random.Generator) -> Choice | None:
        """The best of the options, varied a little if placements may be proposed; None without any."""
        thin = subsample(belief, self.particles)
        options = self._free(belief, self.actions.options(thin, self.metric))
        if not len(options):
            return None
        (squeezed,) = self._squeeze([thin], [options], rng)
        if self.actions.proposals is not None:
            top = squeezed.placements[np.argsort(-squeezed.rank, kind="stable")[:REFINED]]
            near = self.actions.within(np.concatenate([refined(placement) for placement in top]))
            near = self._free(belief, near)
            if len(near):
                squeezed = _joined(squeezed, self._squeeze([thin], [near], rng)[0])
        (values,) = self._follow([squeezed], depth, 0, rng)
        best = int(np.argmax(values))
        gain = max(values[best] + self.costs.squeeze, squeezed.progress[best]) - self.metric.mode(thin).ratio
        return Choice(squeezed.placements[best], float(values[best]), float(gain))

    def _values(self, beliefs: list[Array], depth: int, level: int, rng: np.random.Generator) -> Array:
        """V of each belief, `depth` squeezes to go."""
        values = np.array([self.metric.mode(belief).ratio - SHRINK / len(belief) for belief in beliefs])
        if depth == 0:
            return values
        still = [i for i, value in enumerate(values) if value < self.confidence]
        options = [self._free(beliefs[i], self.actions.options(beliefs[i], self.metric)) for i in still]
        movable = [(i, choice) for i, choice in zip(still, options, strict=True) if len(choice)]
        squeezed = self._squeeze([beliefs[i] for i, _ in movable], [choice for _, choice in movable], rng)
        for (i, _), worth in zip(movable, self._follow(squeezed, depth, level, rng), strict=True):
            values[i] = max(values[i], float(worth.max()))
        return values

    def _squeeze(
        self, beliefs: list[Array], options: list[Array], rng: np.random.Generator
    ) -> list[_Squeezed]:
        """Every option of every belief, once, in one batch."""
        cases = [(belief, a) for belief, choice in zip(beliefs, options, strict=True) for a in choice]
        outcomes = self.model.squeeze(cases, rng)
        result, start = [], 0
        for choice in options:
            result.append(self._judge(choice, outcomes[start : start + len(choice)]))
            start += len(choice)
        return result

    def _judge(self, placements: Array, outcomes: list[Outcomes]) -> _Squeezed:
        """What one squeeze each is worth."""
        cost = np.array([self.costs.of(outcome) for outcome in outcomes])
        progress, worth, rank = [], [], []
        for outcome, price in zip(outcomes, cost, strict=True):
            few = np.array([SHRINK / len(child) for child in outcome.beliefs])
            modes = [self.metric.main_modes(child, self.metric.modes + 1) for child in outcome.beliefs]
            first = (
                np.array([sum(mode.ratio for mode in found[: self.metric.modes]) for found in modes]) - few
            )
            further = np.array([sum(mode.ratio for mode in found[self.metric.modes :]) for found in modes])
            progress.append(float(outcome.probability @ (first + few)))
            worth.append(float(outcome.probability @ first) - price)
            rank.append(worth[-1] + SECOND_MODE * float(outcome.probability @ further))
        return _Squeezed(placements, outcomes, cost, np.array(progress), np.array(worth), np.array(rank))

    def _follow(
        self, squeezed: list[_Squeezed], depth: int, level: int, rng: np.random.Generator
    ) -> list[Array]:
        """Value of every option, the promising ones followed for the squeezes that remain."""
        values = [options.worth.copy() for options in squeezed]
        if depth == 1:
            return values
        width = FOLLOWED[min(level, len(FOLLOWED) - 1)]
        followed = [
            (i, int(k))
            for i, options in enumerate(squeezed)
            if options.worth.max() < 1.0 - 2.0 * self.costs.squeeze
            for k in np.argsort(-options.rank, kind="stable")[:width]
        ]
        children = [child for i, k in followed for child in squeezed[i].outcomes[k].beliefs]
        worth = self._values(children, depth - 1, level + 1, rng)
        start = 0
        for i, k in followed:
            outcome = squeezed[i].outcomes[k]
            stop = start + len(outcome.beliefs)
            values[i][k] = float(outcome.probability @ worth[start:stop]) - squeezed[i].cost[k]
            start = stop
        return values

    def _free(self, belief: Array, placements: Array) -> Array:
        """Those of the placements at which the open fingers stay clear of the belief."""
        part, jaws = self.simulator.outline, self.simulator.jaws
        free = free_placements(part, jaws, belief, placements, LEAST_CLEARANCE_MM)
        if self.crash_share > 0.0 and not free.any():
            free = free_placements(part, jaws, belief, placements, 0.0, self.crash_share)
        return np.asarray(placements[free])


def _joined(a: _Squeezed, b: _Squeezed) -> _Squeezed:
    """The options of both."""
    return _Squeezed(
        np.concatenate([a.placements, b.placements]),
        a.outcomes + b.outcomes,
        np.concatenate([a.cost, b.cost]),
        np.concatenate([a.progress, b.progress]),
        np.concatenate([a.worth, b.worth]),
        np.concatenate([a.rank, b.rank]),
    )
