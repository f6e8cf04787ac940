"""A plan held to `goal.wrong_ppm`: studies of rare wrong answers, and the leaves that are to blame.

A study is looked at after each batch of chunks, as many as all before it, and ends as soon as the rate is
shown to be below the limit or above it: its bounds hold at every look (`planner.evaluation.ppm`).
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from planner.belief.metric import Metric, Mode
from planner.belief.particles import Belief
from planner.evaluation.disturbance import NONE
from planner.evaluation.ppm import CHUNK, Findings, Study, Sums, Wrong, copies_of
from planner.evaluation.trials import Program
from planner.job.model import Job
from planner.search.expand import TreeNode, breadth_first
from planner.work.progress import Report
from planner.work.scheduler import Scheduler
from planner.world import ContactWorlds
from runtime.table import Table

MOST_PARTS = 2_000_000  # of a study: without a wrong answer among them the bound is about 4 ppm
CUT_PARTS = 20_000  # of that of a plan whose search was cut short
FIRST = 2  # chunks before the first look
AIM = 0.5  # of the limit: what the leaves left alone may come to, so that a bound on it is below the limit
AMPLIFIED = 0.1  # least share of a doubted belief that is wrong, for a look-ahead of few particles to see it


class Doubt(NamedTuple):
    """A leaf made to be searched once more, and what it was before."""

    node: TreeNode
    belief: Belief
    mode: Mode


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What a study found."""

    found: Findings  # rates and bounds
    wrong: Wrong  # the parts that were answered wrongly

    def to_blame(self, limit: float) -> dict[int, Belief]:
        """Leaves without which the table would keep below a limit [ppm], and their wrong parts.

        Those wrong for the largest share of their own parts come first: then the fewest parts are concerned.
        """
        wrong, visits = self.found.sums.wrong, self.found.sums.visits
        order = sorted(np.flatnonzero(wrong).tolist(), key=lambda leaf: -wrong[leaf] / visits[leaf])
        left, named = self.found.wrong.rate, []
        for leaf in order:
            if left <= AIM * limit:
                break
            left -= self.found.leaves[leaf].rate
            named.append(leaf)
        parts = Belief.of(self.wrong.poses, self.wrong.counts, self.wrong.traits)
        return {k: parts[self.wrong.leaf == k] for k in named}


def studied(
    table: Table, job: Job, limit: float, seed: int, scheduler: Scheduler, report: Report,
    most: int | None = None,
) -> Case:  # fmt: skip
    """Studies a table in its job's own world until wrong answers are shown to be below a limit, or above it.

    The limit is in ppm; `plan-evaluate --ppm --seed` follows the same parts. The result does not depend on
    the scheduler. It ends in any case after `most` parts, `MOST_PARTS` if None.
    """
    worlds = ContactWorlds.of_job(job, seed)
    study = Study(Program.of(table), job, worlds, seed, copies_of(table), NONE)
    sums, told, done, chunks = Sums.none(len(table.leaves)), list[Wrong](), 0, (most or MOST_PARTS) // CHUNK
    while done < chunks and not (done and Findings.of(sums).decided(limit)):
        batch = range(done, min(max(FIRST, 2 * done), chunks))
        for more, wrong in scheduler.map(study.looked_into, batch):
            sums += more
            told.append(wrong)
        done = batch.stop
        report("wrong answers", done, chunks)
    return Case(Findings.of(sums), Wrong(*map(np.concatenate, zip(*told, strict=True))))


def unsettle(root: TreeNode, wrong: Mapping[int, Belief], metric: Metric) -> list[Doubt]:
    """Joins wrong parts, amplified, to the beliefs of their leaves, by leaf number.

    The tree is modified in place. Returns the leaves, with what they were before.
    """
    ends = [node for node in breadth_first(root) if not node.children]
    found = []
    for leaf, parts in wrong.items():
        node = ends[leaf]
        found.append(Doubt(node, node.belief, node.mode))
        times = math.ceil(AMPLIFIED / (1.0 - AMPLIFIED) * len(node.belief) / len(parts))
        more = parts[np.tile(np.arange(len(parts)), times)]
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


def given_up(table: Table, leaves: Collection[int]) -> Table:
    """The table with some leaves marked unresolved."""
    rows = enumerate(table.leaves)
    told = (leaf._replace(resolved=leaf.resolved and k not in leaves) for k, leaf in rows)
    return replace(table, leaves=tuple(told))
