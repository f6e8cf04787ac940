"""From a job to a decision table: the whole planner on one screen."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from planner.arrays import BoolArray
from planner.belief.metric import metric_of
from planner.belief.observation import encoder_of, resolution_of
from planner.belief.particles import Belief, initial_with_friction
from planner.belief.partition import Estimate
from planner.belief.transition import MotionModel, Simulation, costs_of
from planner.diagnosis.ambiguity import ambiguities
from planner.errors import NoPlanError
from planner.evaluation.evaluate import evaluate
from planner.evaluation.measured import predicting, tried, with_figures, without_untried
from planner.evaluation.outcome import Evaluation
from planner.evaluation.stress import Doubt, beyond, doubt, settle, stressed
from planner.job.model import Job
from planner.learned.model import learned_model, learns
from planner.learned.store import Store
from planner.lower import lower
from planner.mechanics.simulator import Simulator
from planner.paper.plan import plan_paper
from planner.paper.search import METHODS
from planner.part.outline import radius_of_gyration
from planner.search.actions import actions_of
from planner.search.closed_loop import LookAhead
from planner.search.expand import Growth, TreeNode, grow, learn
from planner.search.handling import handling_of
from planner.search.improve import improve
from planner.search.params import Objective, SearchParams
from planner.search.ranking import Ranking
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorld
from runtime.table import Table, refuted

EVALUATION_TRIALS = 20_000
PARAMS = SearchParams()
SEED_EVALUATION = 0x4556
SEED_WORLD = 0x574F

Judge = Callable[[Table, int], Evaluation]
"""Trials of a table, in an attempt."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A compiled job.

    Attributes:
        table: the decision table, with the evaluation's figures.
        root: the tree with its beliefs, for reports.
        evaluation: what the table was judged by.
        untried: how many branches no trial took, so that their widths are REJECT.
    """

    table: Table
    root: TreeNode
    evaluation: Evaluation
    untried: int


def compile_job(
    job: Job,
    workers: int | None = None,
    trials: int = EVALUATION_TRIALS,
    report: Report | None = None,
    budget_s: float = math.inf,
    store: Store | None = None,
    scheduler: Scheduler | None = None,
) -> Plan:
    """Plans, lowers the tree to a table, and evaluates the table.

    Args:
        job: the checked job.
        workers: threads; all cores if None. The result does not depend on it.
        trials: parts squeezed in the evaluation.
        report: told about progress.
        budget_s: the tree is left as it stands after this long: whole and valid, but with leaves that do not
            know. Without a budget the same seed gives the same bytes.
        store: where the roll-outs of a learned model are kept; nowhere if None.
        scheduler: who rolls them out and runs worlds that are off; as many threads as `workers` if None.

    Raises:
        ClusterError: the cluster was lost.
        NoPlanError: the first squeeze already has no placement free of collision that gains anything, or no
            leaf of the tree is within the goal.
    """
    say = report or silent
    if job.search.method in METHODS:
        return _paper_plan(job, workers, trials, say)
    simulator = Simulator.of_job(job, workers)
    reference = Simulation(simulator, encoder_of(job))
    belief = initial_with_friction(job, job.search.particles, np.random.default_rng([job.seed, 0]))
    # Kernels compile at their first call; no budget pays for that.
    reference.squeeze([(belief[:2], np.zeros(3))], np.random.default_rng(0))
    deadline = time.monotonic() + budget_s
    ahead: MotionModel = Simulation(Simulator.of_job(job, workers, PARAMS.ahead_step_mm), encoder_of(job))
    if learns(job):
        ahead = learned_model(job, simulator, store, scheduler, say)[0]
    growth = _growth(job, simulator, ahead, reference)
    root = TreeNode(belief, 1.0, growth.objective.metric.mode(belief.poses))
    planning = _Planning(job, root, growth, simulator.workers, scheduler, say, deadline)
    judge = partial(_judge, job, trials, simulator.workers)
    table, evaluation, attempt = planning.run(judge)
    others = beyond(table, job, trials, attempt, scheduler or Threads(simulator.workers))
    plan = _plan(job, root, table, evaluation, others, judge)
    if not plan.evaluation.success.any():
        raise _no_plan(plan.table, plan.evaluation, job)
    return plan


@dataclass(frozen=True, slots=True, eq=False)
class _Planning:
    """A tree being planned: grown, improved, judged, and grown further where it falls short."""

    job: Job
    root: TreeNode
    growth: Growth
    workers: int
    scheduler: Scheduler | None
    say: Report
    deadline: float

    def run(self, judge: Judge) -> tuple[Table, Evaluation, int]:
        """Plans the whole tree; the table, its trials, and the attempt that they belong to."""
        doubts: list[Doubt] = []
        for attempt in range(PARAMS.refinements + 1):
            self._grow(attempt)
            settle(doubts, self.growth.objective.confidence)
            table = lower(self.root, self.job)
            self.say("evaluate", attempt, PARAMS.refinements + 1)
            evaluation = judge(table, attempt)
            if attempt == PARAMS.refinements or self._late():
                break
            short, doubts = self._faults(table, evaluation, attempt)
            if short < PARAMS.least_short and not doubts:
                break
        return table, evaluation, attempt

    def _grow(self, attempt: int) -> None:
        """Grows the leaves that fall short; at first, tries other squeezes for the nodes that matter most."""
        seed = [self.job.seed, attempt]
        reopen = self._reopen if attempt else 1.0
        grow(self.root, self.growth, seed, lambda a, b: self.say("search", a, a + b), self._late, reopen)
        if not self.root.children:
            raise NoPlanError(
                f"{self.job.part.name}: no first squeeze is free of collision and gains anything; open the "
                "jaws wider, add actions, or reduce the uncertainty"
            )
        if attempt == 0:
            improve(self.root, self.growth, seed, lambda a, b: self.say("improve", a, a + b), self._late)

    def _faults(self, table: Table, evaluation: Evaluation, attempt: int) -> tuple[float, list[Doubt]]:
        """The share of leaves that do not hold in fresh trials, and those wrong in worlds a little off."""
        metric = self.growth.objective.metric
        last = evaluation.counts[np.arange(len(evaluation.leaf)), evaluation.squeezes - 1]
        beliefs = {
            k: Belief.of(evaluation.poses[evaluation.leaf == k], last[evaluation.leaf == k])
            for k in range(len(table.leaves))
        }
        against = [k for k in beliefs if self._refuted(evaluation.within[evaluation.leaf == k])]
        short = learn(self.root, beliefs, self.growth, self._reopen, against)
        runs = stressed(table, self.job, attempt, self.scheduler or Threads(self.workers))
        return short, doubt(self.root, runs, metric)

    def _refuted(self, within: BoolArray) -> bool:
        """Whether trials that came to a leaf speak against it, or are likely to once the plan is done."""
        confidence = self.job.goal.confidence
        fails = len(within) >= PARAMS.leaf_trials and float(within.mean()) < confidence
        return fails or refuted(int(within.sum()), len(within), confidence)

    @property
    def _reopen(self) -> float:
        """Mode ratio below which a leaf is grown further: fresh trials must not refute what stays."""
        return 1.0 - PARAMS.reopen_margin * (1.0 - self.job.goal.confidence)

    def _late(self) -> bool:
        """Whether the budget is spent; never before there is a first squeeze, for a plan must be one."""
        return bool(self.root.children) and time.monotonic() > self.deadline


def _paper_plan(job: Job, workers: int | None, trials: int, say: Report) -> Plan:
    """Plans by the paper's method, and evaluates the table; nothing is expanded further for what is found."""
    root = plan_paper(job, Simulator.of_job(job, workers), report=say)
    if not root.children:
        raise NoPlanError(
            f"{job.part.name}: no first squeeze is free of collision and keeps the singleton ratio"
        )
    table, judge = lower(root, job), partial(_judge, job, trials, workers)
    return _plan(job, root, table, judge(table, 0), [], judge)


def _judge(job: Job, trials: int, workers: int | None, table: Table, attempt: int) -> Evaluation:
    """Squeezes fresh parts as a table says."""
    world = ContactWorld(job, job.seed + SEED_WORLD + attempt, workers)
    return evaluate(table, job, world, trials, job.seed + SEED_EVALUATION + attempt)


def _plan(
    job: Job, root: TreeNode, table: Table, evaluation: Evaluation, others: list[Evaluation], judge: Judge
) -> Plan:
    """Puts the figures in, and leaves out what no trial took.

    The trials that chose what stays cannot tell what else parts may do: fresh ones judge the rest.

    Raises:
        NoPlanError: nothing stays.
    """
    table, evaluation = with_figures(table, evaluation, others, job)
    kept = tried(table, [evaluation, *others])
    if not kept[0]:
        raise _no_plan(table, evaluation, job)
    untried = sum(len(node.branches) - len(numbers) for node, numbers in zip(table.nodes, kept, strict=True))
    if untried:
        table = without_untried(table, root, kept)
        evaluation = judge(table, PARAMS.refinements + 1)
    return Plan(predicting(table, evaluation), root, evaluation, untried)


def _no_plan(table: Table, evaluation: Evaluation, job: Job) -> NoPlanError:
    """Why no leaf knows its pose: what stays open, and what would tell it apart."""
    goal = f"{job.goal.distance_mm} mm at confidence {job.goal.confidence}"
    reasons = [leaf.line() for leaf in ambiguities(table, evaluation, job, most=1)]
    error = NoPlanError(
        "; ".join([f"{job.part.name}: no leaf comes within {goal}; add actions, or ask for less", *reasons])
    )
    error.success = float(np.mean(evaluation.within))
    return error


def _growth(job: Job, simulator: Simulator, ahead: MotionModel, reference: MotionModel) -> Growth:
    """How a job's tree is grown: one model to look ahead with, one for the beliefs of the tree itself."""
    metric = metric_of(job, radius_of_gyration(job.part.outline_mm))
    costs = costs_of(job)
    estimate = Estimate(1.0 - PARAMS.goal_margin * (1.0 - job.goal.confidence), 1.0 / costs.least)
    rule = PARAMS.rule(metric, estimate, resolution_of(encoder_of(job)))
    objective = Objective(rule, costs, PARAMS)
    ranking = Ranking(actions_of(job), simulator, ahead, objective, job.goal.crash_share)
    look_ahead = LookAhead(ranking, job.search.depth, job.search.search_particles)
    return Growth(look_ahead, reference, handling_of(job), job.search.max_depth)
