"""From a job to a decision table: the whole planner on one screen."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.arrays import BoolArray
from planner.belief.metric import metric_of
from planner.belief.observation import encoder_of
from planner.belief.particles import initial_with_friction
from planner.belief.transition import MotionModel, Simulation, costs_of
from planner.diagnosis.ambiguity import ambiguities
from planner.errors import NoPlanError
from planner.evaluation import rare
from planner.evaluation.cases import stress_cases
from planner.evaluation.evaluate import evaluate
from planner.evaluation.judge import claimed
from planner.evaluation.measured import predicting, tried, with_figures, without_untried
from planner.evaluation.outcome import Evaluation
from planner.evaluation.ppm import Findings
from planner.evaluation.stress import Doubt, beyond, doubt, settle, stressed, unsettle
from planner.job.model import Job
from planner.learned.model import learned_model, learns
from planner.learned.store import Store
from planner.lower import lower
from planner.mechanics.simulator import Simulator
from planner.paper.plan import plan_paper
from planner.paper.search import METHODS
from planner.part.outline import radius_of_gyration
from planner.search.actions import actions_of
from planner.search.anytime import AFTER_GROWTH, CAREFUL, MENDING, Anytime, Cut, hasty_root
from planner.search.closed_loop import LookAhead
from planner.search.expand import Growth, TreeNode, breadth_first, grow, learn
from planner.search.handling import handling_of
from planner.search.improve import improve
from planner.search.params import Objective, SearchParams
from planner.search.ranking import Ranking
from planner.work.limit import Limit
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorld, ContactWorlds
from runtime.table import Table, refuted

EVALUATION_TRIALS = 20_000
PARAMS = SearchParams()
SEED_EVALUATION = 0x4556
SEED_WORLD = 0x574F
TIMED_TRIALS = 500  # parts squeezed to tell how long an evaluation takes
TIGHT = (
    0.3  # share of a budget that evaluations may take, before fewer parts decide how a hasty tree grows on
)
TIGHT_TRIALS = 4  # they are the trials of the last evaluation, divided by this
USUAL_SQUEEZES = 3.5  # of a part, before the tree is whole
SEED_FIGURES = 0x46494755
SEED_RARE = 0x52415245

Judge = Callable[[Table, int], Evaluation]
"""Trials of a table, in an attempt."""


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
    say("kernels", 0, 1)
    reference.squeeze([(belief[:2], np.zeros(3))], np.random.default_rng(0))
    limit = limit or Limit()
    limit.start()
    ahead: MotionModel = Simulation(Simulator.of_job(job, workers, PARAMS.ahead_step_mm), encoder_of(job))
    if learns(job):
        ahead = learned_model(job, simulator, store, scheduler, say)[0]
    growth = _growth(job, simulator, ahead, reference)
    root = TreeNode(belief, 1.0, growth.objective.metric.mode(belief.poses))

    work = scheduler or Threads(simulator.workers)

    def planning(top: TreeNode, hasty: bool) -> _Planning:
        anytime = Anytime(growth, limit, hasty)
        return _Planning(job, top, growth, simulator.workers, trials, work, say, anytime)

    judge = partial(_judge, job, trials, simulator.workers)
    careful = planning(root, False)
    planned = (
        _within(planning(hasty_root(root), True), careful, judge) if limit.bounded else careful.run(judge)
    )
    table, untried = planned.by.finished(planned, judge)
    plan = _stated(job, planned.by.root, table, untried, trials, work, say, planned.cut)
    if not plan.evaluation.success.any():
        raise _no_plan(plan.table, plan.evaluation, job, plan.cut)
    return plan


class _Planned(NamedTuple):
    """What planning came to."""

    by: _Planning
    table: Table
    evaluation: Evaluation  # its trials
    attempt: int  # that they belong to
    cut: Cut | None = None

    def value(self, growth: Growth) -> float:
        """Success, less what the squeezes cost."""
        return float(
            self.evaluation.success.mean() - growth.objective.costs.least * self.evaluation.squeezes.mean()
        )


def _within(hasty: _Planning, careful: _Planning, judge: Judge) -> _Planned:
    """The better of a hasty plan and, if there is time for it, a careful one."""

    def decide(table: Table, attempt: int) -> Evaluation:
        return _judge(hasty.job, hasty.deciding, hasty.workers, table, attempt)

    found, limit = hasty.run(decide), hasty.anytime.limit
    needed_s = CAREFUL * hasty.anytime.growth_s
    if found.cut or limit.over(needed_s):
        best = found if limit.over() else _improved(hasty, found, decide)
        return best._replace(cut=Cut(limit.asked, 0.0, needed_s * (1.0 + AFTER_GROWTH)))
    careful.begin()
    if careful.anytime.cut:
        return found._replace(cut=careful.anytime.report())
    better = careful.run(judge)
    return max(better, found._replace(cut=better.cut), key=lambda plan: plan.value(careful.growth))


def _improved(hasty: _Planning, found: _Planned, judge: Judge) -> _Planned:
    """The better of a hasty plan and the same with other squeezes tried for as long as there is time."""
    other = replace(hasty, root=deepcopy(hasty.root))
    mending_s = MENDING * hasty.anytime.growth_s
    other.improve([hasty.job.seed, 0], lambda: hasty.anytime.limit.over(mending_s))
    return max(found, other.run(judge), key=lambda plan: plan.value(hasty.growth))


@dataclass(frozen=True, slots=True, eq=False)
class _Planning:
    """A tree being planned: grown, improved, judged, and grown further where it falls short."""

    job: Job
    root: TreeNode
    growth: Growth
    workers: int
    trials: int
    work: Scheduler
    say: Report
    anytime: Anytime

    def finished(self, planned: _Planned, judge: Judge) -> tuple[Table, int]:
        """All else that trials decide: the table, and how many branches were cut off."""
        table, runs = self._marked(planned.table, planned.evaluation, planned.attempt)
        if self.job.goal.wrong_ppm is not None and planned.cut is None:
            table, runs = self._held(self.job.goal.wrong_ppm, table, runs, judge)
        return _pruned(self.job, self.root, table, runs, planned.cut)

    def _held(
        self, limit: int, table: Table, runs: list[Evaluation], judge: Judge
    ) -> tuple[Table, list[Evaluation]]:
        """Grows the leaves that are wrong too often [ppm], and marks those unresolved that do not grow.

        No more parts are given up so than the goal's confidence leaves open.
        """
        given_up, spare = list[TreeNode](), 1.0 - self.job.goal.confidence
        for number in range(1, PARAMS.refinements + 2):
            case = rare.studied(
                table, self.job, limit, self.job.seed + SEED_RARE + number, self.work, self.say
            )
            blamed = case.to_blame(limit)
            if case.found.wrong.high < limit or not blamed:
                break
            ends = _ends(self.root)
            if number <= PARAMS.refinements and not self._late():
                attempt = PARAMS.refinements + number
                doubts = unsettle(self.root, blamed, self.growth.objective.metric)
                self._grow(attempt)
                settle(doubts, self.growth.objective.confidence)
                table = lower(self.root, self.job)
                table, runs = self._marked(table, judge(table, attempt), attempt)
            for leaf in blamed:
                share = case.found.sums.visits[leaf] / case.found.sums.parts
                if not ends[leaf].children and share <= spare:
                    given_up.append(ends[leaf])
                    spare -= share
            table = rare.given_up(table, [k for k, end in enumerate(_ends(self.root)) if end in given_up])
        return table, runs

    def _marked(self, table: Table, evaluation: Evaluation, attempt: int) -> tuple[Table, list[Evaluation]]:
        """Marks the leaves unresolved that trials refute, and returns the trials: here and beyond."""
        others = beyond(table, self.job, self.trials, attempt, self.work)
        return _marked(self.job, table, evaluation, others), [evaluation, *others]

    def run(self, judge: Judge) -> _Planned:
        """Plans the whole tree, unless it was grown before."""
        doubts: list[Doubt] = []
        for attempt in range(PARAMS.refinements + 1):
            if attempt or not self.root.children:
                self._grow(attempt)
            settle(doubts, self.growth.objective.confidence)
            table = lower(self.root, self.job)
            self.say("evaluate", attempt, PARAMS.refinements + 1)
            began_s = self.anytime.limit.spent_s
            evaluation = judge(table, attempt)
            self._reserve(self.anytime.limit.spent_s - began_s, evaluation)
            if attempt == PARAMS.refinements or self._late():
                break
            short, doubts = self._faults(table, evaluation, attempt)
            if short < PARAMS.least_short and not doubts:
                break
        return _Planned(self, table, evaluation, attempt, self.anytime.report())

    def begin(self) -> None:
        """Grows the tree, without a look at what becomes of it."""
        self._grow(0)

    def _grow(self, attempt: int) -> None:
        """Grows the leaves that fall short; at first, tries other squeezes for the nodes that matter most."""
        seed = [self.job.seed, attempt]
        if attempt == 0:
            self.anytime.grow(self.root, seed, self._watch)
        else:
            grow(self.root, self.growth, seed, self._watch, self._late, self._reopen)
        if not self.root.children:
            raise NoPlanError(
                f"{self.job.part.name}: no first squeeze is free of collision and gains anything; open the "
                "jaws wider, add actions, or reduce the uncertainty"
            )
        if attempt == 0 and not self.anytime.hasty:
            self.improve(seed, self._late)

    def improve(self, seed: list[int], late: Callable[[], bool]) -> None:
        """Tries other squeezes for the nodes that matter most, until it is late."""
        improve(self.root, self.growth, seed, lambda a, b: self.say("improve", a, a + b), late)

    def _faults(self, table: Table, evaluation: Evaluation, attempt: int) -> tuple[float, list[Doubt]]:
        """The share of leaves that do not hold in fresh trials, and those wrong in worlds a little off."""
        metric = self.growth.objective.metric
        beliefs = {k: evaluation.poses[evaluation.leaf == k] for k in range(len(table.leaves))}
        against = [k for k in beliefs if self._refuted(evaluation.within[evaluation.leaf == k])]
        short = learn(self.root, beliefs, self.growth, self._reopen, against)
        runs = stressed(table, self.job, attempt, self.work)
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
        """Whether the time is spent; never before there is a first squeeze, for a plan must be one."""
        return self.anytime.late(self.root)

    @property
    def deciding(self) -> int:
        """Parts that decide how a tree grows on."""
        return max(1, self.trials // TIGHT_TRIALS) if self.anytime.tight else self.trials

    def _watch(self, *_: int) -> None:
        """Tells how the tree grows; once it has a squeeze, a few trials tell how long many will take."""
        limit = self.anytime.limit
        if limit.bounded and not limit.reserve_s and self.root.children:
            table = lower(self.root, self.job)
            _judge(self.job, 1, self.workers, table, 0)  # its kernels are loaded then
            began_s = limit.spent_s
            timed = _judge(self.job, TIMED_TRIALS, self.workers, table, 0)
            took_s = limit.spent_s - began_s
            self._reserve(took_s, timed)
            self.anytime.tight = limit.reserve_s > TIGHT * limit.budget_s
            self._reserve(took_s, timed)
        self.say("draft" if self.anytime.hasty else "search", *self.anytime.told(self.root))

    def _reserve(self, took_s: float, evaluation: Evaluation) -> None:
        """Keeps time for the evaluations after the growth, given one and how long it took."""
        goal, limit = self.job.goal, self.anytime.limit
        doubted = math.ceil(self.job.friction.doubt * self.trials)
        parts = self.deciding + 2 * (self.trials + doubted) + goal.stress_trials * len(stress_cases(self.job))
        mean = float(evaluation.squeezes.mean())
        each_s = took_s / len(evaluation.squeezes)
        limit.reserve_s = each_s * parts * max(1.0, USUAL_SQUEEZES / mean)


def _paper_plan(job: Job, workers: int | None, trials: int, say: Report) -> Plan:
    """Plans by the paper's method, and evaluates the table; nothing is expanded further for what is found."""
    root = plan_paper(job, Simulator.of_job(job, workers), report=say)
    if not root.children:
        raise NoPlanError(
            f"{job.part.name}: no first squeeze is free of collision and keeps the singleton ratio"
        )
    table = lower(root, job)
    evaluation = _judge(job, trials, workers, table, 0)
    table, untried = _pruned(job, root, _marked(job, table, evaluation, []), [evaluation])
    work = Threads() if workers is None else Threads(workers)
    return _stated(job, root, table, untried, trials, work, say)


def _judge(job: Job, trials: int, workers: int | None, table: Table, attempt: int) -> Evaluation:
    """Squeezes fresh parts as a table says."""
    world = ContactWorld(job, job.seed + SEED_WORLD + attempt, workers)
    return evaluate(table, job, world, trials, job.seed + SEED_EVALUATION + attempt)


def _marked(job: Job, table: Table, evaluation: Evaluation, others: list[Evaluation]) -> Table:
    """The table with the leaves unresolved that trials refute; its shares stay those of the plan."""
    return replace(table, leaves=with_figures(table, evaluation, others, job)[0].leaves)


def _pruned(
    job: Job, root: TreeNode, table: Table, runs: list[Evaluation], cut: Cut | None = None
) -> tuple[Table, int]:
    """Cuts off what no trial took, in the tree, too: the table, and how many branches went.

    The first of `runs` is that in the job's own world.

    Raises:
        NoPlanError: nothing stays.
    """
    kept = tried(table, runs)
    if not kept[0]:
        raise _no_plan(table, runs[0], job, cut)
    untried = sum(len(node.branches) - len(numbers) for node, numbers in zip(table.nodes, kept, strict=True))
    return (without_untried(table, root, kept) if untried else table), untried


def _ends(root: TreeNode) -> list[TreeNode]:
    """The leaves of a tree, in the order of its table."""
    return [node for node in breadth_first(root) if not node.children]


def _stated(
    job: Job, root: TreeNode, table: Table, untried: int, trials: int, work: Scheduler, say: Report,
    cut: Cut | None = None,
) -> Plan:  # fmt: skip
    """Puts figures in, of trials that had no part in any decision.

    A table must not call a leaf resolved that its own figures refute: it is marked, and its parts count as
    failures in these very figures. Other trials would be chosen for not refuting it.
    """
    others = [] if job.search.method in METHODS else beyond(table, job, trials, SEED_FIGURES, work)
    seed = job.seed + SEED_FIGURES
    evaluation = evaluate(table, job, ContactWorlds.of_job(job, seed), trials, seed, work)
    table, evaluation = with_figures(table, evaluation, others, job)
    wrong, limit = None, job.goal.wrong_ppm
    if limit is not None:
        most = rare.CUT_PARTS if cut else rare.MOST_PARTS
        wrong = rare.studied(table, job, limit, job.seed + SEED_RARE, work, say, most).found
    cut = cut and cut._replace(open_share=float(evaluation.unresolved.mean()))
    return Plan(predicting(table, evaluation), root, evaluation, untried, seed, wrong, cut)


def _no_plan(table: Table, evaluation: Evaluation, job: Job, cut: Cut | None) -> NoPlanError:
    """Why no leaf knows its pose; if the search was complete, also what would tell it apart."""
    evaluation = replace(evaluation, resolved=claimed(table, evaluation.leaf))
    goal = f"{job.goal.distance_mm} mm at confidence {job.goal.confidence}"
    if cut is not None:
        error = NoPlanError(f"{job.part.name}: {cut.line()}; no leaf is within {goal} yet")
    else:
        reasons = [leaf.line() for leaf in ambiguities(table, evaluation, job, most=1)]
        problem = f"{job.part.name}: no leaf comes within {goal}; add actions, or ask for less"
        error = NoPlanError("; ".join([problem, *reasons]))
    error.success = float(np.mean(evaluation.within))
    return error


def _growth(job: Job, simulator: Simulator, ahead: MotionModel, reference: MotionModel) -> Growth:
    """How a job's tree is grown: one model to look ahead with, one for the beliefs of the tree itself."""
    objective = Objective(
        metric_of(job, radius_of_gyration(job.part.outline_mm)),
        confidence=1.0 - PARAMS.goal_margin * (1.0 - job.goal.confidence),
        costs=costs_of(job),
        params=PARAMS,
    )
    ranking = Ranking(actions_of(job), simulator, ahead, objective, job.goal.crash_share)
    look_ahead = LookAhead(ranking, job.search.depth, job.search.search_particles)
    return Growth(look_ahead, reference, handling_of(job), job.search.max_depth)
