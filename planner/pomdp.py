"""The planner's problem as a generative POMDP on arrays, for external solvers.

A state (4,) is the part's pose and the opening of the jaws: x, y [mm] and theta [rad] in the world, width
[mm] as the encoder measures it without noise. Constant errors of the cell are at the middle of their
intervals in the job's section [doubt]. An action (4,) is a pose and its use: x, y, theta, and 0 to squeeze
with the hand placed there or 1 to declare that the part lies there. An observation is a reading of the
encoder, in steps of closing. A belief is an array of n equally likely states (n, 4).

    model = Pomdp.of_job(job)
    belief = model.initial(2000, rng)
    belief = model.updated(belief, model.actions[0], reading, rng)
    declared = [*model.metric.mode(belief[:, :3]).pose, DECLARE]
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.random import Generator
from scipy.special import ndtr

from planner import arguments
from planner.arrays import Array, BoolArray, IntArray
from planner.belief.doubts import stated
from planner.belief.metric import Metric, metric_of
from planner.belief.observation import Encoder, encoder_of
from planner.belief.particles import initial
from planner.belief.stopping import FAILURE
from planner.belief.transition import read_as
from planner.frames import to_hand, to_world
from planner.job.model import Job
from planner.mechanics.simulator import Simulator
from planner.mechanics.squeeze import JAMMED
from planner.mechanics.traits import ordinary
from planner.search.actions import actions_of

SQUEEZE, DECLARE = 0.0, 1.0  # use of an action's pose; from 0.5 on it is declared
MOST_CANDIDATES = 64  # most poses that `Pomdp.actions` declares
# Candidate poses come from `TRIED` simulated parts, each after `SQUEEZED` random squeezes.
TRIED, SQUEEZED = 4000, 3
SEED_CANDIDATES = 0x43414E44


class Sampled(NamedTuple):
    """Results of n actions."""

    states: Array  # (n, 4) states afterwards
    observations: IntArray  # (n,) readings
    rewards: Array  # (n,) -1 a squeeze; `Pomdp.success` for a declared pose within the goal, 0 for another
    ended: BoolArray  # (n,) a pose was declared, or an open finger came down on the part


def declares(actions: Array) -> BoolArray:
    """Whether actions (..., 4) declare a pose."""
    return np.asarray(actions[..., 3] >= 0.5 * (SQUEEZE + DECLARE))


@dataclass(frozen=True, slots=True, eq=False)
class Pomdp:
    """The POMDP of a job; every squeeze draws its mechanics afresh (paper IV)."""

    job: Job
    simulator: Simulator
    encoder: Encoder
    metric: Metric  # metric of the goal
    success: float  # reward for declaring a pose within the goal; a squeeze costs 1
    placements: int  # number of `actions` that squeeze; they come first
    actions: Array  # (k, 4) the job's placements of the hand, then declarations of candidate poses

    @classmethod
    def of_job(cls, job: Job, workers: int = 1) -> Self:
        """Builds the POMDP of a job; simulates parts to find candidate poses, in some tenths of a second.

        Raises:
            ValueError: the job has several hypotheses.
        """
        if job.hypothesis:
            raise ValueError(f"{job.name}: this problem is of one part; pass one of `job.alone`")
        simulator, metric = Simulator.of_job(job, workers), metric_of(job)
        placements = actions_of(job).placements
        squeezes = np.column_stack([placements, np.full(len(placements), SQUEEZE)])
        model = cls(job, simulator, encoder_of(job), metric, FAILURE, len(squeezes), squeezes)
        # Candidates are the commonest poses of parts after some squeezes, the commonest first.
        rng = np.random.default_rng([job.seed, SEED_CANDIDATES])
        states = model.initial(TRIED, rng)
        for _ in range(SQUEEZED):
            drawn = squeezes[rng.integers(len(squeezes), size=TRIED)]
            states = model.sample(states, drawn, rng).states
        modes = metric.main_modes(states[:, :3], MOST_CANDIDATES)
        declarations = [[*mode.pose, DECLARE] for mode in modes]
        return replace(model, actions=np.concatenate([squeezes, declarations]))

    def initial(self, n: int, rng: Generator) -> Array:
        """Draws n states (n, 4) from the job's uncertainty, with open jaws."""
        n = arguments.count(n, "n", 0)
        return np.column_stack([initial(self.job, n, rng), np.full(n, self.encoder.opening_mm)])

    def sample(self, s: Array, a: Array, rng: Generator) -> Sampled:
        """Draws the result of an action in each of n states.

        Args:
            s: the states (n, 4).
            a: one action (4,) for all states, or actions (n, 4), one for each state.
            rng: draws mechanics and noise.

        Raises:
            ValueError: the shapes do not fit, or a number is not finite.
        """
        states = arguments.rows(s, "states", 4).copy()
        actions = arguments.rows(np.broadcast_to(a, states.shape), "actions", 4)
        ended = declares(actions)
        right = self.metric.reached(states[:, :3], actions[:, :3])
        rewards = np.where(ended, self.success * right, -1.0)
        rows = np.flatnonzero(~ended)
        hand, traits = actions[rows, :3].T, stated(self.job, len(rows))
        parameters = self.simulator.sample(
            len(rows), rng, None if ordinary(traits).all() else traits
        )
        felt = to_hand(states[rows, :3], hand)
        felt[:, 1] -= traits["across_mm"]  # where the fingers meet
        rolled = self.simulator.roll_out(felt, parameters)
        rolled.poses[:, 1] += traits["across_mm"]
        seen_mm = np.maximum(read_as(rolled.width_mm, traits), 0.0)
        states[rows, :3] = to_world(rolled.poses, hand)
        states[rows, 3] = np.where(rolled.width_mm > 0.0, seen_mm, 0.0)
        # Fingers that stand on the part do not close at all.
        ended[rows] = (rolled.status == JAMMED) & (rolled.width_mm >= self.encoder.opening_mm)
        return Sampled(states, self.encoder.read(states[:, 3], rng), rewards, ended)

    def likelihood(self, o: int | IntArray, s: Array, a: Array) -> Array:
        """Probability (n,) of the reading o if action a has led to the states s (n, 4).

        The result does not depend on the action, since the state contains the width to which the action led.

        Raises:
            ValueError: the states are not (n, 4), the action not (4,), or o is no reading.
        """
        s = arguments.rows(s, "states", 4)
        arguments.row(a, "a", 4)
        read = arguments.indices(np.atleast_1d(o), "o", self.encoder.steps + 1).astype(np.float64)
        encoder = self.encoder
        noise = max(encoder.noise_mm, 1e-9)
        narrow = np.where(read >= encoder.steps, -np.inf, encoder.width_mm(read + 0.5))
        wide = np.where(read <= 0, np.inf, encoder.width_mm(read - 0.5))
        return np.asarray(ndtr((wide - s[:, 3]) / noise) - ndtr((narrow - s[:, 3]) / noise))

    def updated(self, belief: Array, a: Array, o: int, rng: Generator) -> Array:
        """The belief (n, 4) after action a (4,) and reading o: a step of a particle filter.

        It squeezes the states of `belief` (n, 4), weights the results by the likelihood of o, and resamples
        them.

        Raises:
            ValueError: see `sample`; or o is no reading, or none of the states explains it.
        """
        o = arguments.count(o, "o", 0, self.encoder.steps)
        states = self.sample(belief, arguments.row(a, "a", 4), rng).states
        weight = self.likelihood(o, states, a)
        if not weight.any():
            problem = f"none of {len(belief)} states explains the reading {o}"
            raise ValueError(f"{problem}; begin with more of them")
        return np.asarray(states[rng.choice(len(states), len(states), p=weight / weight.sum())])
