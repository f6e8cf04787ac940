"""From a job to a decision table: the whole planner on one screen."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from planner.ambiguity import ambiguities
from planner.belief import initial
from planner.encoder import encoder_of
from planner.errors import NoPlanError
from planner.evaluate import Evaluation, evaluate
from planner.evaluation.stress import Doubt, doubt, settle, stressed
from planner.goal import metric_of
from planner.job import Job
from planner.lower import lower
from planner.measured import with_evaluation
from planner.mechanics.simulator import Simulator
from planner.models.learning import learned_model, learns
from planner.models.store import Store
from planner.part.outline import radius_of_gyration
from planner.progress import Report, silent
from planner.scheduler import Scheduler, Threads
from planner.search.actions import actions_of
from planner.search.closed_loop import LookAhead
from planner.search.costs import costs_of
from planner.search.expand import Growth, TreeNode, grow, learn
from planner.search.handling import handling_of
from planner.search.outcomes import MotionModel, Simulation
from planner.search.paper import METHODS
from planner.search.paper_plan import plan_paper
from planner.world import ContactWorld
from runtime.table import Table, canonical

EVALUATION_TRIALS = 20_000
MARGIN = 0.5
"""Share of the goal's allowed errors at which the search takes a leaf for good: the rest is reserve."""
REFINEMENTS = 3
"""How often leaves are expanded further that fall short of the goal, or would in a world a little off."""
SEED_EVALUATION = 0x4556
SEED_WORLD = 0x574F


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A compiled job.

    Attributes:
        table: the decision table, canonical, with the evaluation's figures.
        root: the tree with its beliefs, for reports.
        evaluation: what the table was judged by.
    """

    table: Table
    root: TreeNode
    evaluation: Evaluation


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
    deadline = time.monotonic() + budget_s
    simulator = replace(Simulator.of_job(job, workers), doubt=job.friction.doubt)
    threads = Threads(simulator.workers)
    reference = Simulation(simulator, encoder_of(job))
    ahead: MotionModel = reference
    if learns(job):
        ahead = learned_model(job, simulator, store, scheduler, say)[0]
    growth = _growth(job, simulator, ahead, reference)
    look_ahead = growth.look_ahead
    belief = initial(job, job.search.particles, np.random.default_rng([job.seed, 0]))
    root = TreeNode(belief, 1.0, look_ahead.metric.mode(belief))
    doubts: list[Doubt] = []
    for attempt in range(REFINEMENTS + 1):
        grow(
            root,
            growth,
            [job.seed, attempt],
            lambda a, b: say("search", a, a + b),
            lambda: time.monotonic() > deadline,
        )
        settle(doubts)
        if not root.children:
            raise NoPlanError(
                f"{job.part.name}: no first squeeze is free of collision and gains anything; open the jaws "
                "wider, add actions, or reduce the uncertainty"
            )
        table = canonical(lower(root, job))
        say("evaluate", attempt, REFINEMENTS + 1)
        world = ContactWorld(job, job.seed + SEED_WORLD + attempt, workers)
        evaluation = evaluate(table, job, world, trials, job.seed + SEED_EVALUATION + attempt)
        if attempt == REFINEMENTS or time.monotonic() > deadline:
            break
        beliefs = {k: evaluation.poses[evaluation.leaf == k] for k in range(len(table.leaves))}
        short = learn(root, beliefs, look_ahead)
        doubts = doubt(root, stressed(table, job, attempt, scheduler or threads), look_ahead.metric)
        if short + len(doubts) == 0:
            break
    table, evaluation = with_evaluation(table, evaluation, job)
    if not evaluation.success.any():
        raise _no_plan(table, evaluation, job)
    return Plan(table, root, evaluation)


def _paper_plan(job: Job, workers: int | None, trials: int, say: Report) -> Plan:
    """Plans by the paper's method, and evaluates the table; nothing is expanded further for what is found."""
    root = plan_paper(job, Simulator.of_job(job, workers), report=say)
    if not root.children:
        raise NoPlanError(
            f"{job.part.name}: no first squeeze is free of collision and keeps the singleton ratio"
        )
    table = canonical(lower(root, job))
    world = ContactWorld(job, job.seed + SEED_WORLD, workers)
    evaluation = evaluate(table, job, world, trials, job.seed + SEED_EVALUATION)
    table, evaluation = with_evaluation(table, evaluation, job)
    return Plan(table, root, evaluation)


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
    look_ahead = LookAhead(
        actions=actions_of(job),
        simulator=simulator,
        model=ahead,
        metric=metric_of(job, radius_of_gyration(job.part.outline_mm)),
        confidence=1.0 - MARGIN * (1.0 - job.goal.confidence),
        depth=job.search.depth,
        costs=costs_of(job),
        particles=job.search.search_particles,
        crash_share=job.goal.crash_share,
    )
    return Growth(look_ahead, reference, handling_of(job), job.search.max_depth)
