"""Planning: passes of the search, then trials that reopen leaves for further search."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from planner.belief.particles import Belief
from planner.diagnosis.ambiguity import ambiguities
from planner.diagnosis.clearance import no_first_squeeze
from planner.errors import NoPlanError
from planner.evaluation.disturbance import NONE, WITH_DOUBTS
from planner.evaluation.evaluate import evaluate
from planner.evaluation.measured import leading, with_figures, without_untried
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.lower import lower
from planner.mechanics.simulator import DEFAULT_STEP_MM
from planner.paper.search import METHODS
from planner.problem import STEP_MM, Problem
from planner.search.effort import PASSES, REPAIR
from planner.search.search import MOST_NODES, Search
from planner.search.tree import Node, leaves, pruned
from planner.work.limit import Limit
from planner.work.progress import Report, silent
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime.table import Table

SEED_EVALUATION = 0x4556
SEED_WORLD = 0x574F
ATTEMPTS = 6  # most rounds of search at leaves that fresh trials reopen
FRESH = 2.0  # fresh trials of the first round, for each particle of the search; half as many later
HOPELESS = 0.5  # share of parts in open leaves after all steps of a pass at which planning ends
LEAST_SHORT = 0.0005  # probability of failing leaves below which they are not searched further
TIMED_TRIALS = 500  # parts squeezed to estimate the duration of an evaluation
LEAST_TRIALS = 1000  # parts of an evaluation when a budget has no time for more
EVALUATING = 0.1  # most of the remaining budget that the first trials may take, and the evaluation
SQUEEZES = 3.0  # least mean number of squeezes that is assumed for a finished plan
CURSORY = 0.2  # share of a budget for the first pass, which may leave some parts without a plan
REPAIRS = 0.15  # share of a budget for leaves that the last pass left open or that trials refute
REPAIRABLE = 0.3  # share of the parts in open leaves below which repairs finish a tree
TRACTABLE = 0.1  # share in open leaves of the pass before, above which a search takes too long
# For progress: share of the work after the passes, and of this the share left after each round of trials.
AFTER_PASSES, AFTER_ROUND = 0.35, 0.7


class Cut(NamedTuple):
    """Why a search was cut short, and the share of parts that it left unresolved."""

    asked: bool  # whether by a request, such as an interrupt; otherwise by the time budget
    open_share: float = 0.0  # share of all parts that end in unresolved leaves

    def figures(self) -> dict[str, Any]:
        """Converts the object to JSON types."""
        by, share = "interrupt" if self.asked else "budget", round(self.open_share, 6)
        return {"by": by, "open_share": share, "seconds_to_finish": None}

    def line(self) -> str:
        """States the cause and the share of parts left unresolved, in one line for people."""
        cause = "request" if self.asked else "the budget"
        return (
            f"CUT SHORT by {cause}: {self.open_share:.2%} of the parts end where the search is not done; "
            "how long the rest of it takes is not known"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A planned tree and its table, without the branches that no trial took."""

    root: Node
    table: Table  # leaves that trials refute are unresolved
    untried: int  # branches that no trial took
    trials: int  # parts of an evaluation: fewer than requested if a budget has no time for them
    cut: Cut | None  # None if the search is complete


class Rounds(NamedTuple):
    """How many parts the trials of a plan squeeze."""

    fresh: int  # parts in the first round of trials; later rounds have half as many
    figures: int  # parts in the evaluation of the finished table

    def within(self, limit: Limit, root: Node, job: Job, workers: int) -> Rounds:
        """Returns these numbers, reduced to what the time budget allows, and reserves the time in `limit`.

        A few trials of the plan at `root` show how much time a part takes.
        """
        table = lower(root, job)
        judged(job, 1, workers, table, 0)  # loads its kernels
        began_s = limit.spent_s
        squeezes = float(judged(job, TIMED_TRIALS, workers, table, 0).squeezes.mean())
        more = max(SQUEEZES / max(squeezes, 1.0), 1.0)
        each_s = more * (limit.spent_s - began_s) / TIMED_TRIALS
        # The evaluation closes the fingers in finer steps.
        finer_s = each_s * STEP_MM / DEFAULT_STEP_MM
        share_s = EVALUATING * max(limit.budget_s - limit.spent_s, 0.0)
        affordable = Rounds(
            min(self.fresh, max(LEAST_TRIALS, int(share_s / each_s))),
            min(self.figures, max(LEAST_TRIALS, int(share_s / finer_s))),
        )
        limit.reserve_s = affordable.fresh * each_s + affordable.figures * finer_s
        return affordable


class Course:
    """Reports the progress of planning: the passes of the search, then the rounds of trials."""

    def __init__(self, report: Report) -> None:
        self.report, self.done = report, 0.0

    def in_pass(self, number: int, open_share: float) -> None:
        """Reports progress in pass `number`, when the share `open_share` of the parts is not yet located."""
        before = sum(stage.work for stage in PASSES[:number])
        self._at((1.0 - AFTER_PASSES) * (before + PASSES[number].work * (1.0 - open_share)))

    def after_trials(self, attempt: int, open_share: float) -> None:
        """Reports progress in the search after round `attempt` of trials; see `in_pass`."""
        self._at(1.0 - AFTER_PASSES * AFTER_ROUND ** (attempt + 1.0 - open_share))

    def _at(self, done: float) -> None:
        """Reports the share of all work that is done; it never falls."""
        self.done = max(self.done, min(done, 1.0))
        self.report("search", round(1000 * self.done), 1000)


def planned(problem: Problem, limit: Limit, trials: int, report: Report = silent) -> Planned:
    """Plans by passes of the search, and continues the search at leaves that fresh trials refute.

    Args:
        problem: the job, resolved.
        limit: states when to stop with the best plan so far.
        trials: parts of the evaluation that follows; time for them is reserved in the budget.
        report: receives the progress.

    Raises:
        NoPlanError: no first squeeze is both free of collision and useful, no leaf is within the goal, or
            most parts stay outside the goal however far the search goes.
    """
    job, course = problem.job, Course(report)
    rounds = Rounds(max(1, round(FRESH * job.search.particles)), trials)
    search = Search(problem, np.random.default_rng([job.seed, len(PASSES)]))
    root, whole = None, True
    for number, stage in enumerate(PASSES):
        before = sum(earlier.work for earlier in PASSES[:number])
        ahead_s = limit.spent_s * stage.work / before if number else 0.0
        if limit.standing and limit.over(limit.budget_s * REPAIRS + ahead_s):
            whole = False
            break
        new = search.begin(stage, root)
        over = partial(limit.over, limit.budget_s * (REPAIRS if number else 1.0 - CURSORY))
        whole = search.grow(new, over, partial(course.in_pass, number))
        if root is None or whole or _better(search, new, root, repairs=not limit.asked):
            root = new
        if not root.actions:
            raise NoPlanError(f"{job.name}: {no_first_squeeze(job)}")
        left = sum(leaf.share for leaf in search.due(root))
        if number and whole and left > HOPELESS and not limit.bounded:
            outside = f"{left:.0%} of the parts are outside the goal after {MOST_NODES} squeezes"
            remedy = "ask for less, add actions, or give a --budget"
            raise NoPlanError(f"{job.name}: {outside}; {remedy}")
        limit.standing = True
        if number == 0 and limit.bounded:
            rounds = rounds.within(limit, root, job, problem.mixture.workers)
    assert root is not None
    left_out, settled = not whole, False
    for attempt in range(ATTEMPTS + 1):
        table = lower(root, job)
        fresh = rounds.fresh if attempt == 0 else -(-rounds.fresh // 2)
        run = judged(job, fresh, problem.mixture.workers, table, attempt)
        if settled or attempt == ATTEMPTS or limit.over():
            whole &= settled or attempt == ATTEMPTS
            break
        settled = search.absorb(root, _ended(run), _strays(run)) < LEAST_SHORT
        if left_out:
            search.reopen(root)
        search.stage = REPAIR._replace(frugal=left_out and attempt == 0)
        whole &= search.grow(root, limit.over, partial(course.after_trials, attempt))
    cut = None if whole else Cut(limit.asked)
    return finished(root, job, table, run, rounds.figures, cut)


def _better(search: Search, new: Node, root: Node, *, repairs: bool) -> bool:
    """Whether the tree of a pass that was cut short is better than the tree `root` of the pass before.

    If no `repairs` follow that can finish the new tree, its unfinished actions are removed first.
    """
    feasible = search.missing(root) < TRACTABLE and search.missing(new) < REPAIRABLE
    if repairs and feasible and not search.stage.explores:
        return new.value < root.value
    return search.close(new) or search.missing(new) < search.missing(root)


def _ended(run: Evaluation) -> dict[int, Belief]:
    """The parts of an evaluation, grouped by the leaf that they reached."""
    parts = _parts(run)
    return {int(leaf): parts[run.leaf == leaf] for leaf in np.unique(run.leaf[run.leaf >= 0])}


def _strays(run: Evaluation) -> dict[int, Belief]:
    """The parts whose last width fitted no branch, grouped by the node at which it was read."""
    parts, rejected = _parts(run), run.rejected & (run.squeezes > 0)
    node = run.path[np.arange(len(run.leaf)), run.squeezes - 1]
    return {int(k): parts[rejected & (node == k)] for k in np.unique(node[rejected])}


def _parts(run: Evaluation) -> Belief:
    """All parts of an evaluation with their last readings."""
    return Belief(run.poses, run.traits, run.steps[np.arange(len(run.leaf)), run.squeezes - 1])


def finished(
    root: Node, job: Job, table: Table, run: Evaluation, trials: int, cut: Cut | None = None
) -> Planned:
    """Returns the plan without branches to leaves that no trial of any round reached: REJECT replaces them.

    Raises:
        NoPlanError: no branch remains.
    """
    before = {number for number, leaf in enumerate(leaves(root)) if leaf.fresh}
    kept = leading(table, before.union(run.leaf.tolist()))
    if not kept[0]:
        raise no_plan(table, run, job, cut)
    untried = sum(len(node.branches) for node in table.nodes) - sum(map(len, kept))
    # Only leaves change: refuted leaves become unresolved. Branches keep their shares.
    table = replace(table, leaves=with_figures(table, run, job)[0].leaves)
    return Planned(pruned(root, kept), without_untried(table, kept), untried, trials, cut)


def judged(
    job: Job, trials: int, workers: int | None, table: Table, attempt: int, report: Report = silent
) -> Evaluation:
    """Evaluates a table on newly drawn parts; the fingers close in the same steps as in planning.

    The cell has constant errors as in the job's [doubt], or none for the paper's methods.
    """
    worlds = ContactWorlds.of_job(job, job.seed + SEED_WORLD + attempt, STEP_MM)
    seed, work = job.seed + SEED_EVALUATION + attempt, Threads(workers) if workers else Threads()
    cell = NONE if job.search.method in METHODS else WITH_DOUBTS
    return evaluate(table, job, worlds, trials, seed, work, cell, report)


def no_plan(table: Table, evaluation: Evaluation, job: Job, cut: Cut | None) -> NoPlanError:
    """Returns the error that no leaf reaches the goal.

    If the search was complete and the job has one hypothesis, the error also states where the parts of the
    most frequent unresolved leaf lie.
    """
    evaluation = replace(evaluation, table=table)
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
