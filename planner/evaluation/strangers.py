"""Parts that do not belong on the table: how often one of them is taken for one that does.

A table of a job that names some accepts no more widths than its own parts need, whatever the strangers are.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import IntArray
from planner.belief.observation import Encoder, encoder_of
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import evaluate
from planner.evaluation.expectation import readings
from planner.evaluation.measured import without_untried
from planner.evaluation.outcome import Evaluation
from planner.job.model import Job
from planner.lower import interval_um
from planner.search.expand import TreeNode
from planner.work.scheduler import Scheduler
from planner.world import World, Worlds
from runtime.table import REJECT, Branch, Calibration, Node, Table, by_count, decision_map

PRICE = 5e-6  # of a count that a branch accepts, in parts that belong there


class Strange(NamedTuple):
    """What became of one stranger."""

    name: str
    evaluation: Evaluation
    leaf: int | None  # that most of those answered came to
    widths_mm: tuple[float, ...]  # median widths on the way there: what could not be told apart

    @property
    def answered(self) -> float:
        """Share that ended in a resolved leaf."""
        return float(self.evaluation.resolved.mean())

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "trials": len(self.evaluation.leaf),
            "answered_rate": self.answered,
            "reject_rate": float(self.evaluation.rejected.mean()),
            "unresolved_rate": float(self.evaluation.unresolved.mean()),
            "crashes": self.evaluation.crashes,
            "leaf": self.leaf,
            "widths_mm": [round(width, 2) for width in self.widths_mm],
        }

    def line(self) -> str:
        """For people."""
        told = f"stranger   {self.answered:7.2%}  of {self.name} answered as a part that belongs there"
        if self.leaf is None:
            return told
        widths = ", ".join(f"{width:.1f}" for width in self.widths_mm)
        return f"{told}, most at leaf {self.leaf} by {widths} mm"


def strangers(
    table: Table, job: Job, worlds: Callable[[Job], World | Worlds], trials: int, seed: int,
    scheduler: Scheduler, disturbance: Disturbance,
) -> Iterator[Strange]:  # fmt: skip
    """Runs a table on each stranger of its job; the arguments are those of `evaluate`."""
    for stranger in job.strangers:
        found = evaluate(table, stranger, worlds(stranger), trials, seed, scheduler, disturbance)
        yield Strange(stranger.part.name, found, *_commonest(found, job))


def _commonest(found: Evaluation, job: Job) -> tuple[int | None, tuple[float, ...]]:
    """The leaf that most answered parts came to, and the median widths on the way."""
    if not found.resolved.any():
        return None, ()
    leaf = int(np.bincount(found.leaf[found.resolved]).argmax())
    here = found.leaf == leaf
    counts = found.counts[here][:, : int(found.squeezes[here][0])]  # a tree: one way leads to a leaf
    return leaf, tuple(map(float, encoder_of(job).width_mm(np.median(counts, axis=0))))


class Narrowed(NamedTuple):
    """A table that accepts no more widths than its own parts need."""

    table: Table
    accepted: tuple[int, int]  # counts that mean a branch, over all nodes: before, and now
    lost: float  # share of the parts that it was made with, and were not wrong, which it rejects

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        before, now = self.accepted
        return {"accepted_counts_before": before, "accepted_counts": now, "lost_rate": self.lost}

    def line(self) -> str:
        """For people."""
        before, now = self.accepted
        told = f"narrowed against strangers: {now} of {before} counts are accepted"
        return f"{told}; {self.lost:.3%} of the parts that belong there are rejected for it"


def narrowed(table: Table, root: TreeNode, found: Evaluation, job: Job) -> Narrowed:
    """Narrows each branch to the interval that holds the most readings, less a price for each of its counts.

    They are those of parts that were not wrong, at least one, in trials of the table. Branches that none of
    them took are left out, in the tree under the root, too.
    """
    fine = found.success | found.unresolved
    price, encoder, calibration = PRICE * len(fine), encoder_of(job), Calibration.linear(table.gripper)
    before, nodes, kept = _meanings(table.nodes, calibration), [], []
    for node, meant, seen in zip(table.nodes, before, readings(found, len(table.nodes), fine), strict=True):
        read = [np.where(meant == number, seen, 0) for number in range(len(node.branches))]
        rows = zip(node.branches, read, strict=True)
        nodes.append(node._replace(branches=tuple(_narrow(b, row, price, encoder) for b, row in rows)))
        kept.append([number for number, row in enumerate(read) if row.any()])
    now = _meanings(nodes, calibration)
    for row, numbers in zip(now, kept, strict=True):
        row[~np.isin(row, numbers)] = REJECT
    path, counts = found.path[fine], found.counts[fine]
    lost = ((path >= 0) & (now[path, counts] == REJECT)).any(axis=1)
    accepted = int((before != REJECT).sum()), int((now != REJECT).sum())
    return Narrowed(
        without_untried(replace(table, nodes=tuple(nodes)), root, kept), accepted, float(lost.mean())
    )


def _meanings(nodes: Sequence[Node], calibration: Calibration) -> IntArray:
    """What each count means at each node (n, 256): a branch or `REJECT`."""
    return np.array([by_count(decision_map(node, calibration)) for node in nodes], np.int64)


def _narrow(branch: Branch, read: IntArray, price: float, encoder: Encoder) -> Branch:
    """A branch that reaches as far as pays, and to its expected width; `read` (256,) are its readings."""
    total = np.concatenate([[0.0], np.cumsum(read - price)])
    gain = total[1:] - np.minimum.accumulate(total[:-1])
    last = int(gain.argmax())
    low_um, high_um = interval_um(int(total[: last + 1].argmin()), last, encoder)
    return branch._replace(
        low_um=max(branch.low_um, min(low_um, branch.expected_um)),
        high_um=min(branch.high_um, max(high_um, branch.expected_um)),
    )
