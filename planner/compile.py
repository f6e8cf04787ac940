"""From a job to a decision table: the whole planner on one screen."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from planner import arguments
from planner.belief.doubts import believed, certain
from planner.belief.metric import metric_of
from planner.belief.observation import encoder_of, resolution_of
from planner.belief.particles import Belief
from planner.belief.partition import Estimate, partition
from planner.belief.recut import recut
from planner.belief.transition import MotionModel, Simulation, costs_of, placing_of
from planner.diagnosis.alike import refuse_alike
from planner.errors import NoPlanError
from planner.evaluation import rare
from planner.evaluation.disturbance import as_doubted
from planner.evaluation.evaluate import evaluate
from planner.evaluation.measured import predicting, with_figures
from planner.evaluation.narrowing import Narrowed
from planner.evaluation.outcome import Evaluation
from planner.evaluation.ppm import Findings
from planner.job.model import Job
from planner.learned.model import learned_model, learns
from planner.learned.store import Store
from planner.lower import lower
from planner.mechanics.mixture import Mixture
from planner.mechanics.simulator import Simulator
from planner.paper.plan import plan_paper
from planner.paper.search import METHODS
from planner.planning import PARAMS, SEED_RARE, Planning, guarded, judged, marked, no_plan, pruned, within
from planner.search.actions import ActionSet, actions_of
from planner.search.anytime import Anytime, Cut
from planner.search.closed_loop import LookAhead
from planner.search.expand import Growth, TreeNode
from planner.search.handling import handling_of
from planner.search.hasty import hasty_root
from planner.search.params import Objective
from planner.search.pushes import pusher_of
from planner.search.ranking import Ranking
from planner.search.telling import foremost
from planner.work.limit import Limit
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorlds
from runtime.table import Table

EVALUATION_TRIALS = 20_000
SEED_FIGURES = 0x46494755
SEED_BEYOND = 0x42594E44
SEED_TELLING = 0x54454C4C


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A compiled job."""

    table: Table  # the decision table, with the evaluation's figures
    root: TreeNode  # the tree with its beliefs, for reports
    evaluation: Evaluation  # of the finished table: nothing was decided by it
    untried: int  # how many branches no trial took, so that their widths are REJECT
    # Of the evaluation: `plan-evaluate --seed` with as many trials gives the same figures.
    seed: int
    wrong: Findings | None = None  # of as fresh a study, where the goal states wrong_ppm
    cut: Cut | None = None  # how the search was cut short; None where it was complete
    against: Narrowed | None = None  # what was narrowed against strangers, where the job names some


def compile_job(
    job: Job,
    workers: int | None = None,
    trials: int = EVALUATION_TRIALS,
    report: Report | None = None,
    limit: Limit | None = None,
    store: Store | None = None,
    scheduler: Scheduler | None = None,
) -> Plan:
    """Plans, lowers the tree to a table, and evaluates the table.

    Args:
        job: the checked job.
        workers: threads; all cores if None. The result does not depend on it.
        trials: parts squeezed in the evaluation.
        report: told about progress.
        limit: when to end with the best tree so far, evaluated: whole and valid, but maybe with leaves that
            do not know. Where it has no budget the same seed gives the same bytes.
        store: where the roll-outs of a learned model are kept; nowhere if None.
        scheduler: who rolls them out and runs worlds that are off; as many threads as `workers` if None.

    Raises:
        ClusterError: the cluster was lost.
        NoPlanError: no squeeze tells a pose that the goal asks for; or the first squeeze already has no
            placement free of collision that gains anything; or no leaf of the tree is within the goal.
        ValueError: workers or trials are no such number.
    """
    say = report or silent
    arguments.count(trials, "trials")
    arguments.count(1 if workers is None else workers, "workers")
    refuse_alike(job)
    if job.search.method in METHODS:
        return _paper_plan(job, workers, trials, say)
    mixture = Mixture.of_job(job, workers, PARAMS.step_mm)
    reference = Simulation(mixture, encoder_of(job), placing_of(job))
    belief = believed(job, job.search.particles, np.random.default_rng([job.seed, 0]))
    # Kernels compile at their first call; no budget pays for that.
    say("kernels", 0, 1)
    of_each_form = np.unique(belief.traits["surface"], return_index=True)[1]
    _load_kernels(job, reference, belief[np.append([0, 1], of_each_form)])
    limit = limit or Limit()
    limit.start()
    ahead: MotionModel = replace(reference, simulator=Mixture.of_job(job, workers, PARAMS.ahead_step_mm))
    actions = foremost(actions_of(job), job, ahead, np.random.default_rng([job.seed, SEED_TELLING]))
    if learns(job):
        ahead = learned_model(job, mixture.simulators[0], store, scheduler, say)[0]
    growth = _growth(job, actions, mixture, ahead, reference)
    root = TreeNode(belief, 1.0, growth.objective.metric.mode(belief.states))

    work = scheduler or Threads(mixture.workers)

    def planning(top: TreeNode, hasty: bool) -> Planning:
        anytime = Anytime(growth, limit, hasty)
        return Planning(job, top, growth, mixture.workers, trials, work, say, anytime)

    judge = partial(judged, job, trials, mixture.workers, report=say)
    careful = planning(root, False)
    planned = (
        within(planning(hasty_root(root), True), careful, judge) if limit.bounded else careful.run(judge)
    )
    table, untried = planned.by.finished(planned, judge)
    whole = None if planned.cut else growth
    table, against = guarded(job, planned.by.root, table, trials, mixture.workers, say, whole)
    plan = _stated(job, planned.by.root, table, untried, trials, work, say, planned.cut, against)
    if not plan.evaluation.success.any():
        raise no_plan(plan.table, plan.evaluation, job, plan.cut)
    return plan


def _paper_plan(job: Job, workers: int | None, trials: int, say: Report) -> Plan:
    """Plans by the paper's method, and evaluates the table; nothing is expanded further for what is found."""
    root = plan_paper(job, Simulator.of_job(job, workers), report=say)
    if not root.children:
        raise NoPlanError(
            f"{job.part.name}: no first squeeze is free of collision and keeps the singleton ratio"
        )
    table = lower(root, job)
    evaluation = judged(job, trials, workers, table, 0, report=say)
    table, untried = pruned(job, root, marked(job, table, evaluation), evaluation)
    table, against = guarded(job, root, table, trials, workers, say)
    work = Threads() if workers is None else Threads(workers)
    return _stated(job, root, table, untried, trials, work, say, against=against)


def _stated(
    job: Job, root: TreeNode, table: Table, untried: int, trials: int, work: Scheduler, say: Report,
    cut: Cut | None = None, against: Narrowed | None = None,
) -> Plan:  # fmt: skip
    """Puts figures in, of trials that had no part in any decision.

    A table must not call a leaf resolved that its own figures refute: it is marked, and its parts count as
    failures in these very figures. Other trials would be chosen for not refuting it.
    """
    seed = job.seed + SEED_FIGURES
    evaluation = evaluate(table, job, ContactWorlds.of_job(job, seed), trials, seed, work, report=say)
    beyond, reached = None, np.unique(evaluation.leaf[evaluation.leaf >= 0])
    if len(reached) < len(table.leaves) and not certain(job) and job.search.method not in METHODS:
        other = job.seed + SEED_BEYOND
        worlds = ContactWorlds.of_job(job, other)
        beyond = evaluate(table, job, worlds, trials, other, work, as_doubted(job))
    table, evaluation = with_figures(table, evaluation, beyond, job)
    wrong, limit = None, job.goal.wrong_ppm
    if limit is not None:
        most = rare.CUT_PARTS if cut else rare.MOST_PARTS
        wrong = rare.studied(table, job, limit, job.seed + SEED_RARE, work, say, most).found
    cut = cut and cut._replace(open_share=float(evaluation.unresolved.mean()))
    return Plan(predicting(table, evaluation), root, evaluation, untried, seed, wrong, cut, against)


def _load_kernels(job: Job, reference: MotionModel, belief: Belief) -> None:
    """Squeezes a small belief and cuts its readings."""
    (squeezed,) = reference.squeeze([(belief, np.zeros(3))], np.random.default_rng(0))
    rule = PARAMS.rule(metric_of(job), Estimate(0.5), resolution_of(encoder_of(job)))
    partition(squeezed.belief.states, squeezed.belief.reading, rule)
    recut(squeezed.belief, squeezed.belief, rule)


def objective_of(job: Job) -> Objective:
    """What a job's plan is to reach."""
    costs = costs_of(job)
    estimate = Estimate(job.goal.confidence, 1.0 / costs.least)
    rule = PARAMS.rule(metric_of(job), estimate, resolution_of(encoder_of(job)))
    return Objective(rule, costs, PARAMS)


def _growth(
    job: Job, actions: ActionSet, mixture: Mixture, ahead: MotionModel, reference: MotionModel
) -> Growth:
    """How a job's tree is grown: one model to look ahead with, one for the beliefs of the tree itself."""
    objective = objective_of(job)
    ranking = Ranking(actions, mixture, ahead, objective, job.goal.crash_share)
    look_ahead = LookAhead(ranking, job.search.depth, job.search.search_particles)
    pusher = pusher_of(job, mixture.workers)
    return Growth(look_ahead, reference, handling_of(job), job.search.max_depth, pusher)
