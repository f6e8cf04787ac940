"""The course of planning: a tree is grown, improved, judged, and grown further where it falls short."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from typing import NamedTuple

import numpy as np

from planner.arrays import BoolArray
from planner.belief.particles import Belief
from planner.diagnosis.ambiguity import ambiguities
from planner.diagnosis.clearance import no_first_squeeze
from planner.errors import NoPlanError
from planner.evaluation import rare
from planner.evaluation.confirming import confirm
from planner.evaluation.disturbance import NONE, as_doubted
from planner.evaluation.evaluate import carried_on, evaluate
from planner.evaluation.judge import claimed, rejudged
from planner.evaluation.measured import tried, with_figures, without_untried
from planner.evaluation.narrowing import Narrowed, narrowed
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.lower import holds, lower
from planner.paper.search import METHODS
from planner.search.anytime import AFTER_GROWTH, CAREFUL, COMPLETING, MENDING, Anytime, Cut
from planner.search.expand import Found, Growth, TreeNode, breadth_first, grow, learn
from planner.search.hasty import grow_hastily
from planner.search.improve import improve, mend
from planner.search.params import SearchParams
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler, Threads
from planner.world import ContactWorlds
from runtime.table import Table, refuted

PARAMS = SearchParams()
SEED_EVALUATION = 0x4556
SEED_RARE = 0x52415245
SEED_WORLD = 0x574F
SEED_NARROWING = 0x4E4152
SEED_STRANGERS = 0x53545247
STRANGERS = 2000  # parts of each stranger that say how far a table is narrowed
CONFIRMATIONS = 3  # how often leaves are confirmed against strangers
TIMED_TRIALS = 500  # parts squeezed to tell how long an evaluation takes
# Share of a budget that evaluations may take, before fewer parts decide how a hasty tree grows on.
TIGHT = 0.3
TIGHT_TRIALS = 4  # they are the trials of the last evaluation, divided by this
USUAL_SQUEEZES = 3.5  # of a part, before the tree is whole

# Trials of a table, in an attempt: those before it carried on, or new ones.
Judge = Callable[[Table, int, Evaluation | None], Evaluation]


class Planned(NamedTuple):
    """What planning came to."""

    by: Planning
    table: Table
    evaluation: Evaluation  # its trials
    cut: Cut | None = None

    def value(self, growth: Growth) -> float:
        """Success, less what the squeezes cost."""
        return float(
            self.evaluation.success.mean() - growth.objective.costs.least * self.evaluation.squeezes.mean()
        )


def within(hasty: Planning, careful: Planning, judge: Judge) -> Planned:
    """The better of a hasty plan and, if there is time for it, a careful one."""

    def decide(table: Table, attempt: int, before: Evaluation | None) -> Evaluation:
        return judged(hasty.job, hasty.deciding, hasty.workers, table, attempt, before, hasty.say)

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


def _improved(hasty: Planning, found: Planned, judge: Judge) -> Planned:
    """The better of a hasty plan and the same with other squeezes tried for as long as there is time."""
    other = replace(hasty, root=deepcopy(hasty.root))
    mending_s = MENDING * hasty.anytime.growth_s
    other.improve([hasty.job.seed, 0], lambda: hasty.anytime.limit.over(mending_s))
    return max(found, other.run(judge), key=lambda plan: plan.value(hasty.growth))


@dataclass(frozen=True, slots=True, eq=False)
class Planning:
    """A tree being planned: grown, improved, judged, and grown further where it falls short."""

    job: Job
    root: TreeNode
    growth: Growth
    workers: int
    trials: int
    work: Scheduler
    say: Report
    anytime: Anytime

    def finished(self, planned: Planned, judge: Judge) -> tuple[Table, int]:
        """All else that trials decide: the table, and how many branches were cut off."""
        table, run = marked(self.job, planned.table, planned.evaluation), planned.evaluation
        if self.job.goal.wrong_ppm is not None and planned.cut is None:
            table, run = self._held(self.job.goal.wrong_ppm, table, run, judge)
        return pruned(self.job, self.root, table, run, planned.cut)

    def _held(self, limit: int, table: Table, run: Evaluation, judge: Judge) -> tuple[Table, Evaluation]:
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
                doubts = rare.unsettle(self.root, blamed, self.growth.objective.metric)
                self._grow_open([self.job.seed, attempt], self._reopen)
                rare.settle(doubts, self.growth.objective.confidence)
                table = lower(self.root, self.job)
                run = judge(table, attempt, None)
                table = marked(self.job, table, run)
            for leaf in blamed:
                share = case.found.sums.visits[leaf] / case.found.sums.parts
                if not ends[leaf].children and share <= spare:
                    given_up.append(ends[leaf])
                    spare -= share
            table = rare.given_up(table, [k for k, end in enumerate(_ends(self.root)) if end in given_up])
        return table, run

    def run(self, judge: Judge) -> Planned:
        """Plans the whole tree, unless it was grown before.

        New parts judge it a few times. In between, its leaves are grown until those parts speak against none.
        """
        if not self.root.children:
            self.begin()
        if not self.anytime.hasty:
            self._complete()
        attempt = 0
        for look in count(1):
            first = attempt
            evaluation, short = self._judged(judge, attempt)
            while short >= PARAMS.least_short and attempt < PARAMS.refinements and not self._late():
                attempt += 1
                self._grow_open([self.job.seed, attempt], self._reopen)
                evaluation, short = self._judged(judge, attempt, evaluation)
            if attempt == PARAMS.refinements or self._late():
                break
            if self._mended(attempt + 1):
                attempt += 1
            elif attempt == first or look >= PARAMS.looks:
                break
        # The last trials, too, have told the leaves where parts lie.
        table = lower(self.root, self.job)
        return Planned(self, table, rejudged(table, evaluation), self.anytime.report())

    def begin(self) -> None:
        """Grows the tree, without a look at what becomes of it."""
        seed = [self.job.seed, 0]
        self.anytime.grow(self.root, seed, self._watch, partial(self._told, "first squeeze"))
        if not self.root.children:
            raise NoPlanError(f"{self.job.name}: {no_first_squeeze(self.job)}")

    def _complete(self) -> None:
        """Tries other squeezes for the nodes that matter most, and grows what the first growth left open.

        No other squeezes for several hypotheses: it would take a third of the time, and save 2 % of them.
        """
        seed, kept_s = [self.job.seed, 0], COMPLETING * self.anytime.growth_s
        if not self.job.hypothesis:
            self.improve(seed, lambda: self._late(kept_s), PARAMS.rough)
        self._grow_open(seed)

    def _grow_open(self, seed: list[int], reopen: float = 1.0) -> None:
        """Grows what is open; hastily where a careful tree has spent half of the time that was left."""
        kept_s = 0.0 if self.anytime.hasty else 0.5 * self.anytime.limit.left_s
        grow(self.root, self.growth, seed, self._watch, lambda: self._late(kept_s), reopen)
        if self.anytime.cut:
            grow_hastily(self.root, self.growth, seed, self._watch, self._late, reopen)

    def improve(self, seed: list[int], late: Callable[[], bool], rough: float = 0.0) -> None:
        """Tries other squeezes for the nodes that matter most, until it is late."""
        improve(self.root, self.growth, seed, partial(self._told, "improve"), late, rough)

    def _told(self, stage: str, done: int, waiting: int) -> None:
        self.say(stage, done, done + waiting)

    def _mended(self, attempt: int) -> bool:
        """Whether other squeezes stand above leaves that fail for good, if there is time to judge them."""
        limit = self.anytime.limit

        def late() -> bool:
            return limit.over(limit.reserve_s)

        if self.anytime.hasty or self.job.hypothesis or late():
            return False
        failing = [leaf for leaf in _ends(self.root) if self._fails(leaf)]
        if sum(leaf.share for leaf in failing) < PARAMS.least_short:
            return False
        return mend(self.root, self.growth, [self.job.seed, attempt], self._fails, late)

    def _fails(self, leaf: TreeNode) -> bool:
        """Whether a leaf stays unresolved however the tree grows."""
        confidence = self.job.goal.confidence
        return not holds(leaf, confidence) and not self.growth.worth_growing(leaf, confidence)

    def _judged(
        self, judge: Judge, attempt: int, before: Evaluation | None = None
    ) -> tuple[Evaluation, float]:
        """Trials, which teach the leaves where parts came to lie; the share of those that hold no longer."""
        table, began_s = lower(self.root, self.job), self.anytime.limit.spent_s
        evaluation = judge(table, attempt, before)
        if before is None:
            self._reserve(self.anytime.limit.spent_s - began_s, evaluation)
        squeezed = before.squeezes if before else np.zeros_like(evaluation.squeezes)
        new = evaluation.squeezes != squeezed
        last = evaluation.counts[np.arange(len(evaluation.leaf)), evaluation.squeezes - 1]
        ended, leaf = Belief(evaluation.poses, evaluation.traits, last), evaluation.leaf
        found = {k: Found(ended[leaf == k], new[leaf == k]) for k in range(len(table.leaves))}
        return evaluation, learn(self.root, found, self.growth, self._reopen, self._refuted)

    def _refuted(self, within: BoolArray) -> bool:
        """Whether trials that came to a leaf speak against it, or are likely to once the plan is done."""
        confidence = self.job.goal.confidence
        fails = len(within) >= PARAMS.leaf_trials and float(within.mean()) < confidence
        return fails or refuted(int(within.sum()), len(within), confidence)

    @property
    def _reopen(self) -> float:
        """Mode ratio below which a leaf is grown further: fresh trials must not refute what stays."""
        return 1.0 - PARAMS.reopen_margin * (1.0 - self.job.goal.confidence)

    def _late(self, kept_s: float = 0.0) -> bool:
        """Whether all time but `kept_s` is spent; never before there is a first squeeze: a plan is one."""
        return self.anytime.late(self.root, kept_s)

    @property
    def deciding(self) -> int:
        """Parts that decide how a tree grows on."""
        return max(1, self.trials // TIGHT_TRIALS) if self.anytime.tight else self.trials

    def _watch(self, *_: int) -> None:
        """Tells how the tree grows; once it has a squeeze, a few trials tell how long many will take."""
        limit = self.anytime.limit
        if limit.bounded and not limit.reserve_s and self.root.children:
            table = lower(self.root, self.job)
            judged(self.job, 1, self.workers, table, 0)  # its kernels are loaded then
            began_s = limit.spent_s
            timed = judged(self.job, TIMED_TRIALS, self.workers, table, 0)
            took_s = limit.spent_s - began_s
            self._reserve(took_s, timed)
            self.anytime.tight = limit.reserve_s > TIGHT * limit.budget_s
            self._reserve(took_s, timed)
        self.say("draft" if self.anytime.hasty else "search", *self.anytime.told(self.root))

    def _reserve(self, took_s: float, evaluation: Evaluation) -> None:
        """Keeps time for the evaluations after the growth, given one and how long it took."""
        limit, parts = self.anytime.limit, self.deciding + 2 * self.trials
        rounds = 1 + (CONFIRMATIONS if self.job.goal.stranger_rate else 0)
        parts += narrowing_trials(self.trials) * rounds * bool(self.job.stranger)
        mean = float(evaluation.squeezes.mean())
        each_s = took_s / len(evaluation.squeezes)
        limit.reserve_s = each_s * parts * max(1.0, USUAL_SQUEEZES / mean)


def judged(
    job: Job, trials: int, workers: int | None, table: Table, attempt: int, before: Evaluation | None = None,
    report: Report = silent,
) -> Evaluation:  # fmt: skip
    """Squeezes fresh parts as a table says, or carries those on that were squeezed before its tree grew.

    What the job doubts may be off in their cell. The paper's methods doubt nothing.
    """
    worlds = ContactWorlds.of_job(job, job.seed + SEED_WORLD + attempt)
    seed, work = job.seed + SEED_EVALUATION + attempt, Threads(workers) if workers else Threads()
    cell = NONE if job.search.method in METHODS else as_doubted(job)
    if before is not None:
        return carried_on(before, table, job, worlds.world(len(before.leaf)), seed, cell)
    return evaluate(table, job, worlds, trials, seed, work, cell, report)


def marked(job: Job, table: Table, evaluation: Evaluation) -> Table:
    """The table with the leaves unresolved that trials refute; its shares stay those of the plan."""
    return replace(table, leaves=with_figures(table, evaluation, None, job)[0].leaves)


def pruned(
    job: Job, root: TreeNode, table: Table, run: Evaluation, cut: Cut | None = None
) -> tuple[Table, int]:
    """Cuts off what no trial took, in the tree, too: the table, and how many branches went.

    Raises:
        NoPlanError: nothing stays.
    """
    kept = tried(table, run)
    if not kept[0]:
        raise no_plan(table, run, job, cut)
    untried = sum(len(node.branches) - len(numbers) for node, numbers in zip(table.nodes, kept, strict=True))
    return (without_untried(table, root, kept) if untried else table), untried


def narrowing_trials(trials: int) -> int:
    """Parts that say how far a table is narrowed, which takes more of them than its figures do."""
    return max(20_000, 7 * trials)


def guarded(
    job: Job, root: TreeNode, table: Table, trials: int, workers: int | None, say: Report,
    growth: Growth | None = None,
) -> tuple[Table, Narrowed | None]:  # fmt: skip
    """The table narrowed against strangers, where the job names some.

    Leaves are confirmed where the goal says how many may be answered, and it is told how the tree was grown.
    """
    done = None
    rounds = CONFIRMATIONS if growth is not None and job.goal.stranger_rate else 0
    for attempt in range(1 + rounds if job.stranger else 0):
        seed = SEED_NARROWING + attempt
        table = lower(root, job) if attempt else table
        found = judged(job, narrowing_trials(trials), workers, table, seed, report=say)
        table = marked(job, table, found) if attempt else table
        if not found.success.any():
            return table, None
        strange = [judged(other, STRANGERS, workers, table, seed) for other in job.strangers]
        done = narrowed(table, root, found, strange, job)
        table = done.table if done else table
        if growth is None or not rounds:
            break
        left = [judged(other, STRANGERS, workers, table, SEED_STRANGERS + attempt) for other in job.strangers]
        done = done and done._replace(answered=max(float(each.resolved.mean()) for each in left))
        if attempt == rounds or not confirm(root, left, job, growth, [job.seed, seed]):
            break
    return table, done


def _ends(root: TreeNode) -> list[TreeNode]:
    """The leaves of a tree, in the order of its table."""
    return [node for node in breadth_first(root) if not node.children]


def no_plan(table: Table, evaluation: Evaluation, job: Job, cut: Cut | None) -> NoPlanError:
    """Why no leaf knows its pose; if the search was complete, also what would tell it apart."""
    evaluation = replace(evaluation, resolved=claimed(table, evaluation.leaf))
    goal = f"{job.goal.distance_mm} mm at confidence {job.goal.confidence}"
    if cut is not None:
        error = NoPlanError(f"{job.name}: {cut.line()}; no leaf is within {goal} yet")
    else:
        open_poses = [] if job.hypothesis else ambiguities(table, evaluation, job, most=1)
        reasons = [leaf.line() for leaf in open_poses]
        problem = f"{job.name}: no leaf comes within {goal}; add actions, or ask for less"
        error = NoPlanError("; ".join([problem, *reasons]))
    error.success, error.cut_short = float(np.mean(evaluation.within)), cut is not None
    return error
