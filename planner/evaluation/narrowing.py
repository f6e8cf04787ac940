"""A finished table is narrowed to the widths that its own parts need, so that fewer strangers are answered.

What the strangers are like does not matter: others may come. The tree stays as it is, and what later nodes
accept depends on the way there.
"""

from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.observation import COUNTS, Encoder, encoder_of
from planner.evaluation.expectation import readings
from planner.evaluation.measured import without_untried
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.lower import interval_um
from planner.search.expand import TreeNode
from runtime.table import REJECT, Branch, Calibration, Node, Table, by_count, decision_map

LOST = 1e-3  # share of the own parts that narrowing a table may lose
PRICES = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6, 1e-6, 1e-9)  # of a count that is accepted, in own parts
MARGINS = (0, 1, 2, 3)  # counts accepted beyond the readings of a branch that has few
FEW = 30
MAKING = 2.0 / 3.0  # share of the trials that a table is narrowed by; the others say what that loses


class Narrowed(NamedTuple):
    """A table that accepts no more widths than its own parts need."""

    table: Table
    accepted: tuple[int, int]  # counts that mean a branch, over all nodes: before, and now
    lost: float  # share of the own parts that are rejected for it

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        before, now = self.accepted
        return {"accepted_counts_before": before, "accepted_counts": now, "lost_rate": self.lost}

    def line(self) -> str:
        """For people."""
        before, now = self.accepted
        told = f"narrowed against strangers: {now} of {before} counts are accepted"
        return f"{told}; {self.lost:.3%} of the parts that belong there are rejected for it"


def narrowed(table: Table, root: TreeNode, found: Evaluation, job: Job) -> Narrowed | None:
    """Narrows the branches of a table to what parts that were not wrong were read at, in trials of it.

    Branches that none of them took are left out, in the tree under the root, too. Of some prices and margins
    those are taken that accept the least and lose few of further such parts; None if none loses so few.
    """
    fine, making = found.success | found.unresolved, np.arange(len(found.leaf)) < MAKING * len(found.leaf)
    calibration = Calibration.linear(table.gripper)
    meant = np.array([by_count(decision_map(node, calibration)) for node in table.nodes], np.int64)
    seen, further = readings(found, len(table.nodes), fine & making), fine & ~making
    path, counts = found.path[further], found.counts[further]
    best, least, lost = None, meant.size + 1, 0.0
    for price, margin in product(PRICES, MARGINS):
        kept = _kept(meant, seen, price * making.sum(), margin)
        accepted = int((kept != REJECT).sum())
        rejected = ((path >= 0) & (kept[path, counts] == REJECT)).any(axis=1)
        if accepted < least and len(rejected) and rejected.mean() <= LOST:
            best, least, lost = kept, accepted, float(rejected.mean())
    if best is None:
        return None
    nodes = tuple(_limited(node, row, encoder_of(job)) for node, row in zip(table.nodes, best, strict=True))
    numbers = [sorted(set(row.tolist()) - {REJECT}) for row in best]
    done = without_untried(replace(table, nodes=nodes), root, numbers)
    return Narrowed(done, (int((meant != REJECT).sum()), least), lost)


def _kept(meant: IntArray, seen: IntArray, price: float, margin: int) -> IntArray:
    """What counts still mean, a branch or `REJECT`, of what they `meant` and how often they were `seen`.

    All are (n, 256). The fewer readings a branch has, the further beyond them others lie: the margin [counts]
    goes with fewer than `FEW` of them, and is one less for each tenfold.
    """
    kept, count = np.full_like(meant, REJECT), np.arange(COUNTS)
    for row, means, at in zip(kept, meant, seen, strict=True):
        for number in np.unique(means[(means != REJECT) & (at > 0)]):
            own = means == number
            first, last = _worth(np.where(own, at, 0) - price)
            total = at[own & (count >= first) & (count <= last)].sum()
            more = max(0, margin - max(0, int(np.log10(total / FEW) + 1.0)))
            row[own & (count >= first - more) & (count <= last + more)] = number
    return kept


def _worth(gain: Array) -> tuple[int, int]:
    """First and last of the neighbours that add up to the most."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    last = int((total[1:] - np.minimum.accumulate(total[:-1])).argmax())
    return int(total[: last + 1].argmin()), last


def _limited(node: Node, meant: IntArray, encoder: Encoder) -> Node:
    """A node whose branches reach as far as the counts (256,) that mean them, and to what is expected."""
    rows = ((branch, np.flatnonzero(meant == number)) for number, branch in enumerate(node.branches))
    return node._replace(branches=tuple(_reaching(b, at, encoder) if len(at) else b for b, at in rows))


def _reaching(branch: Branch, counts: IntArray, encoder: Encoder) -> Branch:
    low_um, high_um = interval_um(int(counts[0]), int(counts[-1]), encoder)
    return branch._replace(
        low_um=max(branch.low_um, min(low_um, branch.expected_um)),
        high_um=min(branch.high_um, max(high_um, branch.expected_um)),
    )
