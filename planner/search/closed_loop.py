"""Closed-loop look-ahead: the next squeeze, chosen knowing that the one after may depend on what it shows.

    V(b, d) = max( r(b), max_a [ -c + sum_z P(z | b, a) V(b_z, d - 1) ] ),   V(b, 0) = r(b)

with r the mode ratio and c the cost of a squeeze. Observations partition the particles, so branching on them
costs no more roll-outs than the paper's open-loop search of the same depth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.belief import subsample
from planner.goal import Metric
from planner.search.actions import ActionSet, least_clearance
from planner.search.outcomes import MotionModel

LEAST_CLEARANCE_MM = 0.5
"""Open fingers are never planned nearer to a believed part than this."""


@dataclass(frozen=True, slots=True, eq=False)
class LookAhead:
    """The search for one node's action.

    Attributes:
        actions: what to choose from.
        model: motion and sensor model.
        metric: the goal.
        confidence: mode ratio at which a belief needs no further squeeze.
        depth: squeezes to look ahead.
        squeeze_cost: c.
        particles: size of the belief to search with.
    """

    actions: ActionSet
    model: MotionModel
    metric: Metric
    confidence: float
    depth: int
    squeeze_cost: float
    particles: int

    def clearance(self, belief: Array, placement: Array) -> float:
        """Least distance between the open fingers at a placement and the believed part [mm]."""
        simulator = self.model.simulator
        return least_clearance(simulator.outline, simulator.jaws, belief, placement)

    def best_action(self, belief: Array, rng: np.random.Generator) -> tuple[Array | None, float]:
        """The placement to squeeze at.

        Args:
            belief: (n, 3) particles in the world.
            rng: source of randomness.

        Returns:
            The placement (3,) and its value; None where no action is free of collision or gains anything.
        """
        free = [a for a in self.actions.placements if self.clearance(belief, a) >= LEAST_CLEARANCE_MM]
        if not free:
            return None, 0.0
        thin = subsample(belief, self.particles)
        values = self._action_values([thin], [free], self.depth, rng)[0]
        best = int(np.argmax(values))
        gain = values[best] - self.metric.mode(thin).ratio
        return (free[best] if gain > 0.0 else None), float(values[best])

    def _action_values(
        self, beliefs: list[Array], choices: list[list[Array]], depth: int, rng: np.random.Generator
    ) -> list[Array]:
        """Value of every choice at every belief, all of one depth rolled out in one batch."""
        cases = [(belief, a) for belief, free in zip(beliefs, choices, strict=True) for a in free]
        outcomes = self.model.squeeze(cases, rng)
        children = [child for outcome in outcomes for child in outcome.beliefs]
        values = self._values(children, depth - 1, rng)
        worth, start = [], 0
        for outcome in outcomes:
            part = values[start : start + len(outcome.beliefs)]
            start += len(outcome.beliefs)
            worth.append(float(outcome.probability @ part) - self.squeeze_cost)
        result, start = [], 0
        for free in choices:
            result.append(np.array(worth[start : start + len(free)]))
            start += len(free)
        return result

    def _values(self, beliefs: list[Array], depth: int, rng: np.random.Generator) -> Array:
        """V of each belief."""
        values = np.array([self.metric.mode(belief).ratio for belief in beliefs])
        if depth == 0:
            return values
        open_ones = [i for i, value in enumerate(values) if value < self.confidence]
        free = [
            [a for a in self.actions.placements if self.clearance(beliefs[i], a) >= LEAST_CLEARANCE_MM]
            for i in open_ones
        ]
        movable = [(i, choice) for i, choice in zip(open_ones, free, strict=True) if choice]
        worth = self._action_values([beliefs[i] for i, _ in movable], [c for _, c in movable], depth, rng)
        for (i, _), options in zip(movable, worth, strict=True):
            values[i] = max(values[i], float(options.max()))
        return values
