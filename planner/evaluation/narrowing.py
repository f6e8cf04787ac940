"""A finished table is narrowed to the widths that its own parts need, so that fewer strangers are answered.

A count is worth the own parts that read it, less a price for the stated strangers that are answered by way of
it, and for others that may come. The tree stays as it is; what later nodes accept depends on the way there.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.observation import COUNTS, Encoder, encoder_of
from planner.evaluation.expectation import readings
from planner.evaluation.measured import ending, without_untried
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.lower import interval_um
from planner.search.expand import TreeNode
from runtime.table import REJECT, Calibration, Node, Table, by_count, decision_map

LOSS = 1e-3  # share of the own parts that narrowing a table may lose, where the goal does not say
PRICES = tuple(np.geomspace(0.1, 1e-7, 25))  # of a stranger that is answered, in own parts
COUNT = 2e-3  # of a stranger answered: how bad it is to accept one more count
MARGINS = (0, 1, 3)  # counts accepted beyond the readings of a branch that has few
FEW = 30
MAKING = 2.0 / 3.0  # share of the trials that a table is narrowed by; the others say what that loses


class Narrowed(NamedTuple):
    """A table that accepts no more widths than its own parts need."""

    table: Table
    accepted: tuple[int, int]  # counts that mean a branch, over all nodes: before, and now
    lost: float  # share of the own parts that are rejected for it
    answered: float | None = None  # share of fresh strangers that the table answers, the most of any kind

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        before, now = self.accepted
        told = {"accepted_counts_before": before, "accepted_counts": now, "lost_rate": self.lost}
        return told if self.answered is None else {**told, "answered_rate": self.answered}

    def line(self) -> str:
        """For people."""
        before, now = self.accepted
        told = f"narrowed against strangers: {now} of {before} counts are accepted"
        told += f"; {self.lost:.3%} of the parts that belong there are rejected for it"
        return told + (
            f"; at most {self.answered:.2%} of a stranger answered" if self.answered is not None else ""
        )


def narrowed(
    table: Table, root: TreeNode, found: Evaluation, strange: Sequence[Evaluation], job: Job
) -> Narrowed | None:
    """Narrows the branches of a table to what they are worth.

    Branches that are worth nothing are left out, in the tree under the root, too. For each margin the price
    is the highest that loses few enough own parts; the margin is that which leaves the least to strangers.
    `found` are trials of the own parts, those that were wrong being worth nothing; `strange` of each of at
    least one stranger. None if all prices lose too many.
    """
    fine, making = found.success | found.unresolved, np.arange(len(found.leaf)) < MAKING * len(found.leaf)
    calibration, number = Calibration.linear(table.gripper), len(table.nodes)
    meant = np.array([by_count(decision_map(node, calibration)) for node in table.nodes], np.int64)
    grips = [[branch.grip for branch in node.branches] for node in table.nodes]
    empty = np.array(
        [[n != REJECT and not own[n] for n in row] for own, row in zip(grips, meant, strict=True)]
    )
    seen = readings(found, number, fine & making)
    answered = np.sum([readings(each, number, each.resolved) / len(each.leaf) for each in strange], axis=0)
    loss = LOSS if job.goal.stranger_loss is None else job.goal.stranger_loss
    best, least, lost = meant, np.inf, 1.0
    for margin in MARGINS:
        for price in PRICES:
            costs = price * making.sum() * (COUNT + answered)
            kept = np.where(empty, meant, _kept(meant, seen, costs, margin))
            loses = float(_rejected(kept, found)[fine & ~making].mean())
            if loses <= loss:
                break
        taken = [float((each.resolved & ~_rejected(kept, each)).mean()) for each in strange]
        left = COUNT * (kept != REJECT).sum() + sum(taken)
        if loses <= loss and left < least:
            best, least, lost = kept, left, loses
    if lost > loss:
        return None
    nodes = tuple(_limited(node, row, encoder_of(job)) for node, row in zip(table.nodes, best, strict=True))
    accepted = int((meant != REJECT).sum()), int((best != REJECT).sum())
    ways = ending(table, [set(row.tolist()) for row in best])
    return Narrowed(without_untried(replace(table, nodes=nodes), root, ways), accepted, lost)


def _rejected(kept: IntArray, found: Evaluation) -> BoolArray:
    """Which trials (n,) read a count somewhere that means nothing any more."""
    return np.asarray(((found.path >= 0) & (kept[found.path, found.counts] == REJECT)).any(axis=1))


def _kept(meant: IntArray, seen: IntArray, price: Array, margin: int) -> IntArray:
    """What counts still mean, a branch or `REJECT`, of what they `meant` and how often they were `seen`.

    All are (n, 256), the price of each in readings. The fewer readings a branch has, the further beyond them
    others lie: the margin [counts] goes with fewer than `FEW` of them, and is one less for each tenfold.
    """
    kept, count = np.full_like(meant, REJECT), np.arange(COUNTS)
    for row, means, at, costs in zip(kept, meant, seen, price, strict=True):
        for number in np.unique(means[(means != REJECT) & (at > 0)]):
            own = means == number
            first, last = _worth(np.where(own, at, 0) - costs)
            here = own & (count >= first) & (count <= last)
            if at[here].sum() > costs[here].sum():
                more = max(0, margin - max(0, int(np.log10(at[here].sum() / FEW) + 1.0)))
                row[own & (count >= first - more) & (count <= last + more)] = number
    return kept


def _worth(gain: Array) -> tuple[int, int]:
    """First and last of the neighbours that add up to the most."""
    total = np.concatenate([[0.0], np.cumsum(gain)])
    last = int((total[1:] - np.minimum.accumulate(total[:-1])).argmax())
    return int(total[: last + 1].argmin()), last


def _limited(node: Node, meant: IntArray, encoder: Encoder) -> Node:
    """A node whose grips reach as far as the counts (256,) that mean them, and to what is expected."""
    branches = list(node.branches)
    for number, (low_um, expected_um, high_um, *_) in enumerate(node.branches):
        counts = np.flatnonzero(meant == number)
        if branches[number].grip and len(counts):
            low, high = interval_um(int(counts[0]), int(counts[-1]), encoder)
            reach = {
                "low_um": max(low_um, min(low, expected_um)),
                "high_um": min(high_um, max(high, expected_um)),
            }
            branches[number] = branches[number]._replace(**reach)
    return node._replace(branches=tuple(branches))
