"""Worlds a little off the planned one, so that a plan learns where it would be wrong without a warning.

In the planned world a leaf may be right although no squeeze ever looked at one of the part's coordinates. An
encoder that reads short or a finger that lags disturbs it there: the search then looks at such leaves again.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from planner.arrays import BoolArray
from planner.belief.doubts import certain
from planner.belief.metric import Metric, Mode
from planner.belief.particles import Belief
from planner.evaluation.cases import stress_cases
from planner.evaluation.disturbance import as_doubted
from planner.evaluation.evaluate import evaluate, sweep
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.mechanics.traits import hypothesis_alone
from planner.search.expand import TreeNode, breadth_first
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

TOLERATED = 0.002  # share of confident wrong answers that each such world may have
AMPLIFIED = 0.1  # least share of a doubted belief that is wrong, for a look-ahead of few particles to see it
SEED_STRESS = 0x53545253


class Doubt(NamedTuple):
    """A leaf made to be searched once more, and what it was before."""

    node: TreeNode
    belief: Belief
    mode: Mode


def stressed(table: Table, job: Job, attempt: int, scheduler: Scheduler) -> list[Evaluation]:
    """Runs a table in worlds that are a little off, `goal.stress_trials` parts in each; none if that is 0.

    The random streams are named after the attempt; the result does not depend on the scheduler.
    """
    if job.goal.stress_trials == 0:
        return []
    seed = job.seed + SEED_STRESS + attempt
    worlds, trials = partial(ContactWorlds.of_job, seed=seed), job.goal.stress_trials
    lines = sweep(table, job, stress_cases(job), worlds, trials, seed, scheduler)
    return [line.evaluation for line in lines]


def beyond(table: Table, job: Job, trials: int, attempt: int, scheduler: Scheduler) -> list[Evaluation]:
    """Runs a table beyond the stated world: in cells that the job doubts, if it does, and as `stressed`."""
    runs, seed = [], job.seed + SEED_STRESS + attempt
    if not certain(job):
        worlds, cell = ContactWorlds.of_job(job, seed), as_doubted(job)
        runs.append(evaluate(table, job, worlds, trials, seed, scheduler, cell))
    return [*runs, *stressed(table, job, attempt, scheduler)]


def doubtful(run: Evaluation, leaves: int) -> list[int]:
    """The leaves that are wrong most often: without them the run's wrong answers would be tolerated."""
    wrong = np.bincount(run.leaf[run.wrong], minlength=leaves)
    order = np.argsort(-wrong, kind="stable")
    left = wrong.sum() - np.concatenate([[0], np.cumsum(wrong[order])])
    enough = int(np.argmax(left <= TOLERATED * len(run.leaf)))
    return [int(leaf) for leaf in order[:enough]]


def doubt(root: TreeNode, runs: Sequence[Evaluation], metric: Metric) -> list[Doubt]:
    """Unsettles the leaves that are wrong too often in runs of its table, so that the tree grows on there.

    The tree is modified in place: the beliefs of these leaves are joined by the poses of the parts that were
    wrong there, amplified. Returns the leaves, with what they were before.
    """
    leaves = sum(not node.children for node in breadth_first(root))
    named = sorted({leaf for run in runs for leaf in doubtful(run, leaves)})
    wrong = {k: Belief.joined([_ended(run, (run.leaf == k) & run.wrong) for run in runs]) for k in named}
    return unsettle(root, wrong, metric)


def unsettle(root: TreeNode, wrong: Mapping[int, Belief], metric: Metric) -> list[Doubt]:
    """Joins wrong parts, amplified, to the beliefs of their leaves, by leaf number.

    The tree is modified in place. Returns the leaves, with what they were before.
    """
    ends = [node for node in breadth_first(root) if not node.children]
    found = []
    for leaf, parts in wrong.items():
        node = ends[leaf]
        found.append(Doubt(node, node.belief, node.mode))
        more = _amplified(parts, len(node.belief))
        node.belief, node.doubted = Belief.joined([node.belief, more]), node.doubted + len(more)
        node.mode = metric.mode(node.belief.states)
    return found


def settle(doubts: Sequence[Doubt], confidence: float) -> None:
    """Gives the leaves that no squeeze would improve back what they were.

    Some need no squeeze: another pose of theirs holds for the parts that were wrong, too. They keep it.
    """
    for node, belief, mode in doubts:
        if not node.children and node.mode.ratio < confidence:
            node.doubted -= len(node.belief) - len(belief)
            node.belief, node.mode = belief, mode


def _ended(run: Evaluation, rows: BoolArray) -> Belief:
    """Where some of the parts of a run ended, which they are, and what was read there last."""
    last = run.counts[np.arange(len(rows)), run.squeezes - 1]
    return Belief.of(run.poses[rows], last[rows], hypothesis_alone(run.traits[rows]))


def _amplified(wrong: Belief, among: int) -> Belief:
    """Particles repeated until they count among so many others."""
    times = math.ceil(AMPLIFIED / (1.0 - AMPLIFIED) * among / len(wrong))
    return wrong[np.tile(np.arange(len(wrong)), times)]
