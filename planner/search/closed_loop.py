"""Closed-loop look-ahead: the next squeeze, chosen knowing that the one after may depend on what it shows.

    J(b, d) = min_a [ c(a) + sum_z P(z | b, a) J(b_z, d - 1) ],    J(b, d) = 0 where r(b) meets the goal,
    J(b, 0) = 1 - exp(-(1 - r(b)) / tau) + 1 - r(b)

J is the number of squeezes still to make, c the cost of one (1, and what else it costs in units of that), r
the mode ratio. Where the look-ahead ends J is a guess: a belief that does not meet the goal needs one squeeze
more, however little it lacks, and a second one the more likely the more it lacks. A tree whose beliefs are
all nearly there is worth less than one with most of them done; r alone, which the paper climbs, does not see
that.

Observations partition the particles, so branching on them costs no more roll-outs than the paper's open-loop
search of the same depth. Actions are widened progressively: all of them are squeezed once, and only the most
promising are followed further.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief import subsample
from planner.frames import wrap
from planner.goal import Metric
from planner.mechanics.simulator import Simulator
from planner.search.actions import ActionSet, free_placements
from planner.search.costs import Costs
from planner.search.outcomes import MotionModel, Outcomes
from planner.search.proposals import refined

LEAST_CLEARANCE_MM = 0.5
"""Open fingers are never planned nearer to a believed part than this."""
FOLLOWED = (4, 4, 4)
"""How many actions are followed beyond their first squeeze: at the node itself, one squeeze on, and so on."""
SECOND_MODE = 0.25
"""What explaining a belief by two poses counts against explaining it by one, where actions are ranked."""
TAU = 0.02
"""What a belief may lack, about, before it counts as one that needs another squeeze."""
NEARLY = 0.5
"""Squeezes still to make after one of the options, below which none is followed further."""
LEAST_PROGRESS = 0.001
"""Gain in mode ratio below which no squeeze is planned."""
LOST = 10.0
"""Squeezes that a belief is worth which no squeeze gets nearer the goal, at the end of the look-ahead."""
LUCK = 0.5
"""Standard deviations of the mode ratio that each cluster's mode gains by being chosen for it."""
SHRINK = 1.0
"""Particles that each child belief is taken to have wrong: thin ones look purer than they are."""
ALIKE_MM, ALIKE_DEG = 8.0, 20.0
"""Placements nearer than this are varieties of one."""
WORTH_TRYING = 0.5
"""Squeezes that an alternative may seem to cost more."""
REFINED = 2
"""How many of the best placements are varied."""
HEAVY = 0.2
"""Share of all parts from which a belief is looked ahead with all the particles allowed."""
FEWEST = 0.25
"""Share of those particles that the lightest belief keeps."""


class Choice(NamedTuple):
    """An action for a belief.

    Attributes:
        placement: (3,) the hand frame in the world.
        to_go: J of squeezing there.
        gain: in mode ratio, over stopping here, beyond what luck explains.
    """

    placement: Array
    to_go: float
    gain: float


class _Squeezed(NamedTuple):
    """One belief's options after one squeeze each."""

    placements: Array
    outcomes: list[Outcomes]
    cost: Array
    ratio: Array  # expected mode ratio after it
    to_go: Array  # J of depth 1
    rank: Array  # the same with something for beliefs of two modes; less is better

    def best(self, most: int) -> list[int]:
        """The most promising options."""
        return [int(k) for k in np.argsort(self.rank, kind="stable")[:most]]


class _Followed(NamedTuple):
    """One belief's options after all the squeezes looked ahead; J is infinite where one was not followed."""

    to_go: Array
    ratio: Array


def squeezes_left(ratio: Array) -> Array:
    """J(b, 0) of beliefs with these mode ratios: the squeezes that they still need, guessed."""
    lacking = np.maximum(1.0 - ratio, 0.0)
    return np.asarray(1.0 - np.exp(-lacking / TAU) + lacking)


def luck(ratio: float, particles: int, clusters: int) -> float:
    """What splitting a belief at random adds to its mode ratio: each cluster's mode is chosen to fit it."""
    return float(LUCK * np.sqrt(clusters * ratio * (1.0 - ratio) / particles))


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

        Where nothing gains at the stated depth one squeeze more is looked ahead, with all particles: a belief
        of several modes may need two before any progress shows.

        Args:
            belief: (n, 3) particles in the world, or (n, 4) with friction.
            rng: source of randomness.
            most: how many at most, each unlike those before it.
            share: of all parts that come to this belief: the fewer do, the less is spent on it.

        Returns:
            None at all where no action is free of collision or gains anything.
        """
        few = round(self.particles * max(FEWEST, min(1.0, share / HEAVY) ** 0.5))
        for depth, particles in ((self.depth, few), (self.depth + 1, self.particles)):
            options = self._options(belief, subsample(belief, particles), depth, rng)
            gaining = [choice for choice in options if choice.gain > LEAST_PROGRESS]
            if gaining:
                return _unlike(sorted(gaining, key=lambda choice: choice.to_go), most)
        return []

    def _options(self, belief: Array, thin: Array, depth: int, rng: np.random.Generator) -> list[Choice]:
        """All that may be done, the best of it varied a little if placements may be proposed."""
        options = self._free(belief, self.actions.options(thin, self.metric))
        if not len(options):
            return []
        (squeezed,) = self._squeeze([thin], [options], rng)
        if self.actions.proposals is not None:
            top = squeezed.placements[squeezed.best(REFINED)]
            near = self.actions.within(np.concatenate([refined(placement) for placement in top]))
            near = self._free(belief, near)
            if len(near):
                squeezed = _joined(squeezed, self._squeeze([thin], [near], rng)[0])
        (followed,) = self._follow([squeezed], depth, 0, rng)
        ratio = self.metric.mode(thin).ratio
        chance = [luck(ratio, len(thin), len(outcome.beliefs)) for outcome in squeezed.outcomes]
        gain = np.maximum(followed.ratio, squeezed.ratio) - ratio - np.array(chance)
        found = zip(squeezed.placements, followed.to_go, gain, strict=True)
        return [Choice(a, float(to_go), float(more)) for a, to_go, more in found if np.isfinite(to_go)]

    def _values(
        self, beliefs: list[Array], depth: int, level: int, rng: np.random.Generator
    ) -> tuple[Array, Array]:
        """J of each belief, `depth` squeezes to go, and the mode ratio it then has."""
        ratio = np.array([self.metric.mode(belief).ratio for belief in beliefs])
        short = np.flatnonzero(ratio < self.confidence)
        ratio = ratio - SHRINK / np.array([len(belief) for belief in beliefs])
        to_go = squeezes_left(ratio)
        if depth == 0:
            return to_go, ratio
        options = [self._free(beliefs[i], self.actions.options(beliefs[i], self.metric)) for i in short]
        movable = [(int(i), choice) for i, choice in zip(short, options, strict=True) if len(choice)]
        before = ratio.copy()
        squeezed = self._squeeze([beliefs[i] for i, _ in movable], [choice for _, choice in movable], rng)
        for (i, _), found in zip(movable, self._follow(squeezed, depth, level, rng), strict=True):
            best = int(np.argmin(found.to_go))
            to_go[i], ratio[i] = found.to_go[best], max(ratio[i], found.ratio[best])
        lost = short[ratio[short] < before[short] + LEAST_PROGRESS]
        to_go[lost] += LOST * (1.0 - ratio[lost])
        return to_go, ratio

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
        """What one squeeze each comes to."""
        cost = np.array([self.costs.of(outcome) for outcome in outcomes])
        ratio, to_go, rank = np.zeros(len(cost)), cost.copy(), cost.copy()
        for k, outcome in enumerate(outcomes):
            few = np.array([SHRINK / len(child) for child in outcome.beliefs])
            modes = [self.metric.main_modes(child, self.metric.modes + 1) for child in outcome.beliefs]
            first = np.array([sum(mode.ratio for mode in found[: self.metric.modes]) for found in modes])
            further = np.array([sum(mode.ratio for mode in found[self.metric.modes :]) for found in modes])
            ratio[k] = outcome.probability @ first
            to_go[k] += outcome.probability @ squeezes_left(first - few)
            rank[k] = to_go[k] - SECOND_MODE * (outcome.probability @ further)
        return _Squeezed(placements, outcomes, cost, ratio, to_go, rank)

    def _follow(
        self, squeezed: list[_Squeezed], depth: int, level: int, rng: np.random.Generator
    ) -> list[_Followed]:
        """J of every option, the promising ones followed for the squeezes that remain."""
        found = [_Followed(options.to_go.copy(), options.ratio.copy()) for options in squeezed]
        if depth == 1:
            return found
        width = FOLLOWED[min(level, len(FOLLOWED) - 1)]
        open_ones = [i for i, options in enumerate(squeezed) if (options.to_go - options.cost).min() > NEARLY]
        chosen = [(i, k) for i in open_ones for k in squeezed[i].best(width)]
        children = [child for i, k in chosen for child in squeezed[i].outcomes[k].beliefs]
        to_go, ratio = self._values(children, depth - 1, level + 1, rng)
        for i in open_ones:
            found[i].to_go[:] = np.inf
        start = 0
        for i, k in chosen:
            outcome = squeezed[i].outcomes[k]
            part = slice(start, start + len(outcome.beliefs))
            found[i].to_go[k] = squeezed[i].cost[k] + outcome.probability @ to_go[part]
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


def _unlike(choices: list[Choice], most: int) -> list[Choice]:
    """The first of the choices, and those worth a trial that are not almost the same squeeze."""
    found: list[Choice] = []
    for choice in choices:
        x, y, turn = np.abs([choice.placement - other.placement for other in found]).reshape(-1, 3).T
        turn = np.abs(wrap(turn, 2))
        near = (np.hypot(x, y) < ALIKE_MM) & (turn < np.radians(ALIKE_DEG))
        if not near.any() and choice.to_go < choices[0].to_go + WORTH_TRYING:
            found.append(choice)
    return found[:most]


def _joined(a: _Squeezed, b: _Squeezed) -> _Squeezed:
    """The options of both."""
    return _Squeezed(
        np.concatenate([a.placements, b.placements]),
        a.outcomes + b.outcomes,
        np.concatenate([a.cost, b.cost]),
        np.concatenate([a.ratio, b.ratio]),
        np.concatenate([a.to_go, b.to_go]),
        np.concatenate([a.rank, b.rank]),
    )
