"""The planning problem of a job: the objects that search, lower bound and evaluation share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from planner.belief.costs import Costs
from planner.belief.doubts import believed
from planner.belief.metric import Metric, metric_of
from planner.belief.observation import Encoder, encoder_of, resolution_of
from planner.belief.particles import Belief, evenly
from planner.belief.partition import Rule
from planner.belief.stopping import StoppingRule
from planner.belief.transition import Simulation
from planner.job.model import Job
from planner.mechanics.mixture import Mixture

STEP_MM = 0.8
"""Closing step of squeezes in planning and its trials, twice that of the finished table's evaluation.

All but one in 1000 squeezes end within 0.3 mm and 1 degree of where steps of 0.05 mm do.
"""
AHEAD_STEP_MM = 1.6
"""Closing step of squeezes that only rank grasp poses: all but two in 1000 end within the same distance."""


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """A job's parts, gripper, goal and prices as objects of the planner.

    Attributes:
        job: the checked job.
        encoder: reads widths.
        rule: states how readings are partitioned, when a belief is located, and the leaf heuristic.
        costs: costs of squeezes and pushes.
        model: motion and sensor model of the tree's beliefs.
        ahead: the same models with a coarser closing step, for ranking grasp poses.
    """

    job: Job
    encoder: Encoder
    rule: Rule
    costs: Costs
    model: Simulation
    ahead: Simulation

    @classmethod
    def of(cls, job: Job, workers: int | None = None) -> Self:
        """Builds the problem of a job; squeezes run on `workers` threads, or on all cores if None."""
        encoder, costs = encoder_of(job), Costs(job)
        stopping = StoppingRule(job.goal.confidence)
        rule = Rule(metric_of(job), stopping, resolution_of(encoder))
        model = Simulation(Mixture.of_job(job, workers, STEP_MM), encoder)
        ahead = replace(model, simulator=Mixture.of_job(job, workers, AHEAD_STEP_MM))
        return cls(job, encoder, rule, costs, model, ahead)

    @property
    def metric(self) -> Metric:
        """The goal's metric."""
        return self.rule.metric

    @property
    def stopping(self) -> StoppingRule:
        """The rule by which a belief counts as located."""
        return self.rule.stopping

    @property
    def mixture(self) -> Mixture:
        """The simulators of the parts."""
        assert isinstance(self.model.simulator, Mixture)
        return self.model.simulator

    def belief(self, particles: int, rng: np.random.Generator) -> Belief:
        """The initial belief: poses spread evenly over the job's uncertainty, latent parameters drawn."""
        return believed(self.job, particles, rng, evenly)
