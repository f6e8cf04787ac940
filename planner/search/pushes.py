"""Pushes proposed from a belief: the hand comes down beside all of it and goes straight on through it.

A push tells nothing. It may leave less to be told, and bring parts to where open fingers clear them: one that
takes the pusher past every believed part leaves all of them at its face.
"""

import math
from dataclasses import dataclass
from itertools import product
from operator import attrgetter
from typing import TypeAlias

import numpy as np

from planner.arrays import Array
from planner.belief.observation import encoder_of
from planner.belief.particles import Belief, subsample
from planner.belief.transition import Costs, Push, Simulation, costs_of, placing_of
from planner.job.model import Job
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import by_hypothesis
from planner.search.actions import Action, turnable
from planner.search.closed_loop import LookAhead
from planner.search.ranking import Choice

OPENINGS = (0.0, 0.25, 0.5)
"""Of the jaws while they push, as shares of the full one."""
BESIDE_MM = 2.0  # between the pusher and the nearest believed part where it comes down
BEYOND_MM = 2.0  # how far it goes past where the farthest part begins
FARTHER = (0.0, 0.7)
"""And how much farther, in reaches of the part: parts turn until a side lies at both fingers."""
MOST = 2  # pushes before one squeeze
JUDGED = 200  # particles that judge pushes in the first place
KEPT = 3  # of single pushes, and of pairs of them
FINALISTS = 2  # of these, that are judged as thoroughly as a squeeze without: the first that leave one clear
LEAST_SHARE = 0.02  # of all parts, from which pushes are tried
ROUND_MM = 0.01  # from the area's edge: tables hold whole micrometres
SPREAD = 1e3  # in place of J where no hand is clear of a belief, for each millimetre that it is spread

_Tried: TypeAlias = tuple[tuple[Push, ...], Belief]  # some pushes, and what they have made of a belief


@dataclass(frozen=True, slots=True, eq=False)
class Pusher:
    """Proposes pushes and chooses among them.

    Attributes:
        model: pushes beliefs.
        costs: of a push.
        jaws: (4,) as a `Simulator` has them.
        area: ((x_min, y_min), (x_max, y_max)) that the hand may be placed in.
        turnable: whether a turn of a whole plan about the origin changes nothing: one direction of the first
            push does for all.
        sparing: whether pushes are tried only where no squeeze gains without.
    """

    model: Simulation
    costs: Costs
    jaws: Array
    area: Array
    turnable: bool
    sparing: bool = False

    def options(self, belief: Belief) -> list[Push]:
        """Pushes through a belief, each from beside all of it to beyond where all of it begins."""
        found, reach = list[Push](), max(float(np.hypot(*outline.T).max()) for outline in self._outlines)
        for angle in self._angles(belief):
            along, across = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
            begins, middle = self._begins(belief, along), belief.poses[:, :2].mean(axis=0) @ across
            start, beyond = float(begins.min()) - BESIDE_MM, float(begins.max()) + BEYOND_MM
            place = (start - 0.5 * self.jaws[1]) * along + middle * across
            for opening, farther in product(OPENINGS, FARTHER):
                way_mm = beyond + farther * reach - start
                found.append(Push(np.array([*place, angle]), opening * float(self.jaws[0]), way_mm))
        return [push for push in found if self._within(push)]

    def first(self, belief: Belief, look_ahead: LookAhead, rng: np.random.Generator) -> list[Action]:
        """Pushes before a first squeeze, with the squeeze that seems best after each; the finalists."""
        return [choice.action for choice in self._finalists(belief, look_ahead, rng, 1.0)]

    def choose(
        self, belief: Belief, plain: list[Choice], look_ahead: LookAhead, rng: np.random.Generator, most: int,
        share: float,
    ) -> list[Choice]:  # fmt: skip
        """The choices without a push, and those after one or two.

        The best without comes first, the others as they promise. J is too uncertain for a push to take its
        place at once: the best of dozens seems better than it is. Roll-outs of the alternatives decide.

        Args:
            belief: the node's.
            plain: the choices without.
            look_ahead: judges squeezes.
            rng: source of randomness.
            most: how many at most.
            share: of all parts that come to this belief; pushes are not tried for few.
        """
        if share < LEAST_SHARE or (plain and self.sparing):
            return plain
        others = [*plain[1:], *self._finalists(belief, look_ahead, rng, share)]
        return (plain[:1] + sorted(others, key=attrgetter("cost_to_go")))[:most]

    def _finalists(
        self, belief: Belief, look_ahead: LookAhead, rng: np.random.Generator, share: float
    ) -> list[Choice]:
        """The squeezes that seem best after the most promising pushes."""
        found = list[Choice]()
        for pushes in self._best(belief, look_ahead, rng):
            if len(found) < FINALISTS:
                found += self._after(belief, pushes, look_ahead, rng, share)
        return found

    def _best(
        self, belief: Belief, look_ahead: LookAhead, rng: np.random.Generator
    ) -> list[tuple[Push, ...]]:
        """The most promising pushes, and pairs of them, by few particles and a squeeze each."""
        judged = list[tuple[float, int, tuple[Push, ...]]]()
        begun: list[_Tried] = [((), subsample(belief, JUDGED))]
        for _ in range(MOST):
            tried: list[_Tried] = [
                ((*before, push), self.model.push(thin, push, rng))
                for before, thin in begun
                for push in self.options(thin if before else belief)
            ]
            costs = self._costs(tried, look_ahead, rng)
            order = np.argsort(costs, kind="stable")[:KEPT]
            judged += [(float(costs[k]), len(judged) + n, tried[k][0]) for n, k in enumerate(order)]
            begun = [tried[k] for k in order]
        return [pushes for _, _, pushes in sorted(judged)]

    def _costs(self, tried: list[_Tried], look_ahead: LookAhead, rng: np.random.Generator) -> Array:
        """J (k,) after one squeeze of each pushed belief, with the price of its pushes.

        Where no hand is clear of a belief, the more the farther it is spread.
        """
        ranking = look_ahead.ranking
        options = [ranking.candidates(belief, belief) for _, belief in tried]
        clear = [k for k, own in enumerate(options) if len(own)]
        squeezed = ranking.squeeze([tried[k][1] for k in clear], [options[k] for k in clear], rng)
        costs = np.array([SPREAD * belief.poses[:, :2].std(axis=0).max() for _, belief in tried])
        for k, found in zip(clear, squeezed, strict=True):
            costs[k] = sum(map(self.costs.of_push, tried[k][0])) + found.cost_to_go.min()
        return costs

    def _after(
        self, belief: Belief, pushes: tuple[Push, ...], look_ahead: LookAhead, rng: np.random.Generator,
        share: float,
    ) -> list[Choice]:  # fmt: skip
        """The squeeze that seems best after pushes; none where none gains."""
        made = list[Push]()
        for push in pushes:
            made.append(self._from_beside(push, belief))
            if not self._within(made[-1]):
                return []
            belief = self.model.push(belief, made[-1], rng)
        price = sum(map(self.costs.of_push, made))
        choices = look_ahead.choose(belief, rng, 1, share)
        return [
            choice._replace(cost_to_go=choice.cost_to_go + price, pushes=tuple(made)) for choice in choices
        ]

    def _from_beside(self, push: Push, belief: Belief) -> Push:
        """The same push to the same end, begun far enough back to be clear of all of a belief."""
        along = np.array([np.cos(push.start[2]), np.sin(push.start[2])])
        face = float(push.start[:2] @ along) + 0.5 * float(self.jaws[1])
        back = max(0.0, face + BESIDE_MM - float(self._begins(belief, along).min()))
        return push._replace(start=push.start - back * np.array([*along, 0.0]), way_mm=push.way_mm + back)

    def _within(self, push: Push) -> bool:
        """Whether a push begins and ends in the area."""
        ends = push.start[:2] + np.outer([0.0, push.way_mm], [np.cos(push.start[2]), np.sin(push.start[2])])
        return bool(np.all((ends >= self.area[0] + ROUND_MM) & (ends <= self.area[1] - ROUND_MM)))

    @property
    def _outlines(self) -> tuple[Array, ...]:
        assert isinstance(self.model.simulator, Mixture)
        return self.model.simulator.outlines

    def _angles(self, belief: Belief) -> list[float]:
        """Directions to push in: both ways along and across a belief; one where a turn changes nothing."""
        if self.turnable and not belief.touched:
            return [0.0]
        x, y = (belief.poses[:, :2] - belief.poses[:, :2].mean(axis=0)).T
        angle = 0.5 * math.atan2(2.0 * float((x * y).mean()), float((x * x - y * y).mean()))
        return [angle + quarter * 0.5 * np.pi for quarter in (-2, -1, 0, 1)]

    def _begins(self, belief: Belief, along: Array) -> Array:
        """Where parts (n,) begin along a direction (2,) [mm]."""
        begins = np.empty(len(belief))
        for k, rows in by_hypothesis(belief.traits):
            x, y, theta = belief.poses[rows].T
            c, s = np.cos(theta), np.sin(theta)
            turned = np.stack([c * along[0] + s * along[1], c * along[1] - s * along[0]])
            begins[rows] = x * along[0] + y * along[1] + (self._outlines[k] @ turned).min(axis=0)
        return begins


def pusher_of(job: Job, workers: int | None = None) -> Pusher | None:
    """What proposes pushes for a job; None where it wants none."""
    if job.actions.pushes is None:
        return None
    mixture = Mixture.of_job(job, workers)
    model = Simulation(mixture, encoder_of(job), placing_of(job))
    area = np.array(job.cell.work_area_mm)
    return Pusher(model, costs_of(job), mixture.jaws, area, turnable(job))
