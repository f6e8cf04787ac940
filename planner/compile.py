"""Compiles a job to a decision table: plans, converts the tree to a table, and evaluates the table."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from planner import arguments
from planner.belief.partition import partition
from planner.belief.recut import recut
from planner.diagnosis.alike import refuse_alike
from planner.errors import NoPlanError
from planner.evaluation.evaluate import evaluate
from planner.evaluation.measured import predicting, with_figures
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.lower import lower
from planner.mechanics.simulator import Simulator
from planner.paper.plan import plan_paper
from planner.paper.search import METHODS
from planner.planning import Cut, Planned, finished, judged, no_plan, planned
from planner.problem import Problem
from planner.search.tree import Node
from planner.work.limit import Limit
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorlds
from runtime.table import Table

EVALUATION_TRIALS = 20_000
FEW = 100  # particles of the search that compiles the kernels
SEED_FIGURES = 0x46494755


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A decision table compiled from a job, with its tree and its evaluation."""

    table: Table  # the decision table, with the evaluation's figures
    root: Node  # the tree with its beliefs, for reports
    evaluation: Evaluation  # evaluation of the finished table, by trials that planning did not use
    untried: int  # number of branches that no trial took; their widths are REJECT
    # Seed of the evaluation: `plan-evaluate --seed` with the same number of trials gives the same figures.
    seed: int
    cut: Cut | None = None  # how the search was cut short; None if it was complete


def compile_job(
    job: Job,
    workers: int | None = None,
    trials: int = EVALUATION_TRIALS,
    report: Report | None = None,
    limit: Limit | None = None,
    scheduler: Scheduler | None = None,
) -> Plan:
    """Plans the squeezes of a job, converts the tree to a decision table, and evaluates the table.

    Args:
        job: the checked job.
        workers: number of threads; None: one for each core. The result does not depend on it.
        trials: number of parts squeezed in the evaluation.
        report: receives the progress.
        limit: states when to stop with the best tree so far. The plan is then complete, valid and evaluated,
            but some leaves may be unresolved. Without a time budget the same seed gives the same bytes.
        scheduler: runs the trials of the evaluation; None: as many threads as `workers`.

    Raises:
        UnreachableError: the connection to the cluster was lost.
        NoPlanError: no squeeze distinguishes poses that the goal distinguishes; or no grasp pose of the first
            squeeze is both free of collision and useful; or no leaf of the tree is within the goal.
        ValueError: workers or trials are out of range.
    """
    say = report or silent
    arguments.count(trials, "trials")
    arguments.count(1 if workers is None else workers, "workers")
    refuse_alike(job)
    limit = limit or Limit()
    work = scheduler or (Threads() if workers is None else Threads(workers))
    if job.search.method in METHODS:
        return _measured(job, _by_the_paper(job, workers, trials, say), work, say)
    problem = Problem.of(job, workers)
    say("kernels", 0, 1)
    load_kernels(problem)  # kernels compile at their first call, which no budget should pay for
    limit.start()
    compiled = _measured(job, planned(problem, limit, trials, say), work, say)
    if not compiled.evaluation.success.any():
        raise no_plan(compiled.table, compiled.evaluation, job, compiled.cut)
    return compiled


def _by_the_paper(job: Job, workers: int | None, trials: int, say: Report) -> Planned:
    """Plans by one of the paper's methods: a single search, which is not continued after trials."""
    root = plan_paper(job, Simulator.of_job(job, workers), say)
    if not root.children:
        raise NoPlanError(
            f"{job.part.name}: no first squeeze is free of collision and keeps the singleton ratio"
        )
    table = lower(root, job)
    return finished(root, job, table, judged(job, trials, workers, table, 0, report=say), trials)


def _measured(job: Job, plan: Planned, work: Scheduler, say: Report) -> Plan:
    """Evaluates a plan by trials that were not used in planning, and adds the figures to its table.

    A leaf that the trials refute is marked unresolved, and the parts in it count as failures in the same
    figures. The trials are not repeated after this: to repeat them until no leaf is refuted would select
    lucky trials.
    """
    seed, table, trials = job.seed + SEED_FIGURES, plan.table, plan.trials
    worlds = ContactWorlds.of_job(job, seed)
    evaluation = evaluate(table, job, worlds, trials, seed, work, report=say)
    table, evaluation = with_figures(table, evaluation, job)
    cut = plan.cut and plan.cut._replace(open_share=float(evaluation.unresolved.mean()))
    return Plan(predicting(table, evaluation), plan.root, evaluation, plan.untried, seed, cut)


def load_kernels(problem: Problem) -> None:
    """Calls all kernels, so that they get compiled: a small search, then squeezes with each limit surface."""
    small = problem.job.replaced(search={"particles": FEW})
    with suppress(NoPlanError):
        planned(Problem.of(small, problem.mixture.workers), Limit(0.0), 1)
    belief = problem.belief(problem.job.search.particles, np.random.default_rng(0))
    of_each_form = np.unique(belief.traits["surface"], return_index=True)[1]
    few = belief[np.append([0, min(1, len(belief) - 1)], of_each_form)]
    (squeezed,) = problem.model.squeeze([(few, np.zeros(3))], np.random.default_rng(0))
    partition(squeezed.belief.states, squeezed.belief.reading, problem.rule)
    recut(squeezed.belief, squeezed.belief, problem.rule)
