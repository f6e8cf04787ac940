"""The candidate squeezes of a belief, simulated once each and ranked."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.metric import mode_shares
from planner.belief.observation import COUNTS
from planner.belief.particles import PUSHED, Belief
from planner.belief.partition import intervals, squeezes_left
from planner.belief.transition import MotionModel, Outcomes, Push, Squeezed
from planner.frames import wrap
from planner.kernel import kernel
from planner.mechanics.clearance import free_placements
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import by_hypothesis
from planner.search.actions import Action, ActionSet
from planner.search.params import Objective, SearchParams
from planner.search.proposals import VARIED, varied
from planner.work.scheduler import Threads

TOGETHER = 32  # options that a thread judges at once
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples, cut to their fractions, fill an interval evenly


class Choice(NamedTuple):
    """An action for a belief.

    Attributes:
        placement: (3,) the hand frame to squeeze at, in the world [mm, mm, rad].
        cost_to_go: J of squeezing there.
        gain: in mode ratio over stopping here, selection bias subtracted.
        pushes: before that; J is with their price.
    """

    placement: Array
    cost_to_go: float
    gain: float
    pushes: tuple[Push, ...] = ()

    @property
    def action(self) -> Action:
        """What is done there."""
        return Action(self.placement, self.pushes)


class Options(NamedTuple):
    """One belief's options after one squeeze each.

    Attributes:
        placements: (k, 3) of the hand in the world.
        squeezed: what each makes of the belief.
        branches: (k,) into how many it cuts it.
        cost: (k,) c.
        ratio: (k,) expected mode ratio after it.
        cost_to_go: (k,) J of depth 1.
        rank: (k,) the same less a bonus for beliefs of two modes; less is better.
        compared: (k, 3) the placements as far as they make different squeezes.
    """

    placements: Array
    squeezed: list[Squeezed]
    branches: IntArray
    cost: Array
    ratio: Array
    cost_to_go: Array
    rank: Array
    compared: Array

    def best(self, most: int) -> list[int]:
        """The most promising options."""
        return [int(k) for k in np.argsort(self.rank, kind="stable")[:most]]

    def unlike(self, most: int, params: SearchParams) -> list[int]:
        """The most promising options of which no two are nearly the same squeeze."""
        order = np.argsort(self.rank, kind="stable")
        return [int(order[k]) for k in unlike(self.compared[order], most, params)]

    def joined(self, other: Options) -> Options:
        """These options and others of the same belief."""
        columns = [np.concatenate(pair) for pair in zip(self[2:], other[2:], strict=True)]
        placements = np.concatenate([self.placements, other.placements])
        return Options(placements, self.squeezed + other.squeezed, *columns)


@dataclass(slots=True, eq=False)
class _Contest:
    """The options of one belief while they are halved."""

    belief: Belief
    placements: Array  # (k, 3) of those still in it
    stop: int  # how many of the particles will have squeezed after this round
    # By all particles so far, for each option: poses (k, n, 3), readings (k, n), and `Squeezed`'s two means.
    poses: Array
    reading: IntArray
    means: Array
    options: Options = field(init=False)  # as judged last

    @classmethod
    def of(cls, belief: Belief, placements: Array, params: SearchParams) -> _Contest:
        """The first round: fewer particles the more options there are, spread evenly through the belief."""
        few, k = len(belief), len(placements)
        if k > params.finalists:
            few = min(few, max(params.first_particles, round(params.first_share * few)))
            belief = belief[np.argsort(np.arange(len(belief)) * GOLDEN % 1.0, kind="stable")]
        nothing = np.zeros((k, 0, 3)), np.zeros((k, 0), np.int64), np.zeros((k, 2))
        return cls(belief, placements, few, *nothing)

    @property
    def start(self) -> int:
        """How many of the particles have squeezed."""
        return int(self.reading.shape[1])

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
        means = np.array([new[1:] for new in squeezed])
        self.means = (self.start * self.means + (self.stop - self.start) * means) / self.stop
        poses, reading = zip(*((new.belief.poses, new.belief.reading) for new in squeezed), strict=True)
        self.poses = np.concatenate([self.poses, np.stack(poses)], axis=1)
        self.reading = np.concatenate([self.reading, np.stack(reading)], axis=1)

    def states(self, hypotheses: bool) -> Array:
        """Where all particles so far came to lie (k, n, m), with the number of their hypothesis if asked."""
        if not hypotheses:
            return self.poses
        hypothesis = self.belief.traits["hypothesis"][: self.start].astype(np.float64)
        fourth = np.broadcast_to(hypothesis[:, None], (*self.poses.shape[:2], 1))
        return np.concatenate([self.poses, fourth], axis=2)

    def squeezed(self) -> list[Squeezed]:
        """What all particles so far came to, for each option."""
        traits = self.belief.traits[: self.start]
        each = zip(self.poses, self.reading, self.means.tolist(), strict=True)
        return [Squeezed(Belief(poses, traits, reading), *means) for poses, reading, means in each]

    def halve(self, options: Options, params: SearchParams) -> None:
        """Drops the worse options, unless all particles have judged them."""
        self.options = options
        if self.waiting:
            kept = sorted(options.best(max(params.finalists, -(-len(self.placements) // 2))))
            self.placements, self.means = self.placements[kept], self.means[kept]
            self.poses, self.reading = self.poses[kept], self.reading[kept]
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

    def candidates(self, belief: Belief, about: Belief) -> Array:
        """Placements (k, 3) proposed about a belief, at which the open fingers stay clear of another."""
        if self.actions.first is not None and not belief.touched:
            return self._free(belief, self.actions.first)
        options = self.actions.options(about.states, self.objective.metric)
        if belief.reading[0] == PUSHED:
            options = np.concatenate([options, self.actions.followed(about.poses)])
        return self._free(belief, options)

    def scattered(self, belief: Belief, about: Belief, n: int) -> Array:
        """Likewise of n hands all about a belief; none for a first squeeze that has its own placements."""
        if self.actions.first is not None and not belief.touched:
            return np.zeros((0, 3))
        return self._free(belief, self.actions.scattered(about.states, self.objective.metric, n))

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
            rounds = [(contest.next, contest.placements) for contest in waiting]
            cases = [(particles, a) for particles, placements in rounds for a in placements]
            squeezed = iter(self.model.squeeze(cases, rng))
            for contest in waiting:
                contest.add([next(squeezed) for _ in contest.placements])
            for contest, judgement in zip(waiting, self._judge(waiting), strict=True):
                contest.halve(self._options(contest, *judgement), params)
        return [contest.options for contest in contests]

    def varied(
        self, belief: Belief, thin: Belief, squeezed: Options, n: int, rng: np.random.Generator
    ) -> Options:
        """The options, and n variants of each of the best, thinner each round: a random local search.

        Args:
            belief: whose particles the open fingers stay clear of.
            thin: those of it that are squeezed.
            squeezed: its options.
            n: variants.
            rng: source of randomness.
        """
        for spread in VARIED if self.actions.proposals and belief.touched else ():
            top = squeezed.placements[squeezed.best(self.objective.params.followed)]
            near = self._free(belief, self.actions.within(varied(top, n, spread, rng)))
            if len(near):
                squeezed = squeezed.joined(self.squeeze([thin], [near], rng)[0])
        return squeezed

    def gain(self, belief: Belief, squeezed: Options, after: Array) -> Array:
        """What each option gains in mode ratio, selection bias subtracted.

        Args:
            belief: the particles that were squeezed.
            squeezed: its k options.
            after: (k,) mode ratio expected after each, at the end of the look-ahead.
        """
        metric, params = self.objective.metric, self.objective.params
        ratio = float(metric.shares([belief.states], metric.modes).sum())  # as those after it are found
        bias = [selection_bias(ratio, len(belief), int(k), params) for k in squeezed.branches]
        return np.asarray(after - ratio - np.array(bias))

    def outcomes(self, squeezed: Squeezed) -> Outcomes:
        """The branches of one of the options."""
        return Outcomes.of(squeezed, self.objective.rule)

    def _judge(self, contests: list[_Contest]) -> list[tuple[Array, IntArray]]:
        """The figures (k, 3) of each one's options, and into how many branches (k,) they cut the belief."""
        rule = self.objective.rule
        found = list[tuple[Array, IntArray]]()
        pieces = list[tuple[Array, IntArray, Array, IntArray]]()
        for contest in contests:
            states = contest.states(bool(rule.metric.further))
            figures, branches = np.zeros((len(states), 3)), np.zeros(len(states), np.int64)
            found.append((figures, branches))
            for start in range(0, len(states), TOGETHER):
                some = slice(start, start + TOGETHER)
                pieces.append((states[some], contest.reading[some], figures[some], branches[some]))

        def run(piece: tuple[Array, IntArray, Array, IntArray]) -> None:
            states, reading, figures, branches = piece
            judged(
                states, reading, rule.resolution.free, rule.metric.weights(), rule.metric.modes,
                np.array(rule.estimate), rule.prices(), figures, branches,
            )  # fmt: skip

        deque(Threads(self.mixture.workers).map(run, pieces), maxlen=0)
        return found

    def _options(self, contest: _Contest, figures: Array, branches: IntArray) -> Options:
        """The options as `Outcomes` would have them, whose beliefs are not needed yet."""
        params, (ratio, left, further) = self.objective.params, figures.T
        cost = self.objective.costs.of(*contest.means.T)
        rank = cost + left - params.second_mode * further
        compared = self.actions.compared(contest.placements, contest.belief.touched)
        return Options(
            contest.placements, contest.squeezed(), branches, cost, ratio, cost + left, rank, compared
        )  # fmt: skip

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


@kernel
def judged(
    states: Array, reading: IntArray, free: int, weights: Array, modes: int, estimate: Array, prices: Array,
    figures: Array, branches: IntArray,
) -> None:  # fmt: skip
    """Cuts what options make of a belief into branches, and weighs these.

    Args:
        states: (k, n, m) of the particles after each option.
        reading: (k, n) counts.
        free: least count that an empty hand reads.
        weights: of the metric.
        modes: how many poses a prediction may name.
        estimate: of J.
        prices: see `Rule.prices`.
        figures: (k, 3) receives the expected mode ratio, J at depth 0, and the share in one mode more.
        branches: (k,) receives how many there are.
    """
    n = reading.shape[1]
    weight, start = np.empty(COUNTS, np.int64), np.empty(COUNTS + 1, np.int64)
    bounds, label = np.empty(COUNTS + 1, np.int64), np.empty(COUNTS, np.int64)
    moved, stops = np.empty((states.shape[2], n)), np.empty(COUNTS, np.int64)
    shares = np.empty((COUNTS, modes + 1))
    for option in range(states.shape[0]):
        weight[:] = 0
        for i in range(n):
            weight[reading[option, i]] += 1
        start[0] = 0
        for count in range(COUNTS):
            start[count + 1] = start[count] + weight[count]
        for i in range(n):
            count = reading[option, i]
            moved[:, start[count]] = states[option, i]
            start[count] += 1
        size = branches[option] = intervals(moved, weight, free, weights, modes, estimate, prices, bounds)
        stops[:size] = 0
        for j in range(size):
            label[bounds[j + 1] : bounds[j]] = j
            stops[j] = weight[bounds[j + 1] : bounds[j]].sum()
        start[0] = 0
        for j in range(size):
            start[j + 1] = start[j] + stops[j]
            stops[j] = start[j + 1]
        for i in range(n):
            j = label[reading[option, i]]
            moved[:, start[j]] = states[option, i]
            start[j] += 1
        shares[:size] = 0.0
        mode_shares(moved, stops[:size], weights, shares[:size])
        for j in range(size):
            here = stops[j] - (stops[j - 1] if j else 0)
            first, further = shares[j, :modes].sum(), shares[j, modes]
            left = squeezes_left(first * here, here, estimate[0], estimate[1], estimate[2], estimate[3])
            figures[option, 0] += here / n * first
            figures[option, 1] += here / n * left
            figures[option, 2] += here / n * further


def selection_bias(ratio: float, particles: int, clusters: int, params: SearchParams) -> float:
    """What splitting a belief at random adds to its mode ratio: each cluster's mode is chosen to fit it."""
    return float(params.selection_bias * np.sqrt(clusters * ratio * (1.0 - ratio) / particles))


def distinct(
    choices: list[Choice], compared: Array, most: int, excess: float, params: SearchParams
) -> list[Choice]:
    """The best choice, and others of about its cost that are not nearly the same squeeze.

    Args:
        choices: the best first.
        compared: (k, 3) their placements as far as they make different squeezes.
        most: how many to return at most.
        excess: how much more an alternative may cost [squeezes].
        params: what is alike.
    """
    cheap = [k for k in choices if k.cost_to_go < choices[0].cost_to_go + excess]
    return [cheap[k] for k in unlike(compared[: len(cheap)], most, params)]


def unlike(placements: Array, most: int, params: SearchParams) -> list[int]:
    """Which of the placements (k, 3), the best first, are not nearly the same squeeze as one before."""
    found: list[int] = []
    for k, placement in enumerate(placements):
        x, y, turn = np.abs(placements[found] - placement).T
        near = (np.hypot(x, y) < params.alike_mm) & (np.abs(wrap(turn, 2)) < np.radians(params.alike_deg))
        if len(found) < most and not near.any():
            found.append(k)
    return found
