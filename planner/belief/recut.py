"""Splits a branch where the outcome of the next squeeze shows that this lowers the cost (see paper V.A)."""

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief import partition
from planner.belief.metric import within
from planner.belief.particles import Belief
from planner.belief.stopping import missed
from planner.kernel import kernel


def recut(old: Belief, new: Belief, rule: partition.Rule) -> IntArray:
    """Splits an interval of readings where the outcome of the next squeeze shows that this lowers the cost.

    A rare width beside a common one may look no different until the next squeeze. A piece that already meets
    the goal gets no next squeeze, but becomes a leaf. So its cost is at least the cost of this leaf.

    Args:
        old: n particles, their readings all of one interval.
        new: the same particles after the next squeeze.
        rule: how readings are cut.

    Returns:
        The lowest reading of each piece, in rising order, without that of the lowest piece; empty if the
        interval stays whole.
    """
    cuts = _recut(old.states, old.reading, new.states, new.reading, rule.compiled())
    return np.sort(cuts)


@kernel
def _recut(
    old: Array, old_reading: IntArray, new: Array, new_reading: IntArray, costs: partition.Costs
) -> IntArray:
    """Compiled form of `recut`, but the cuts are unsorted.

    `old` and `new` are the particles' states (n, m) before and after the next squeeze. `old_reading` (n,) are
    the readings that led to the interval, and `new_reading` (n,) those of the next squeeze.
    """
    end = int(old_reading.max()) + 1
    old_cells, old_held, old_steps = partition.into_cells(old_reading, end, costs.coarsest)
    cells, held, steps = partition.into_cells(new_reading, costs.free, costs.coarsest)
    columns, weight, order = partition.by_group(new, cells, held + 1)
    old_columns, old_weight, _ = partition.by_group(old, old_cells, old_held)
    old_counts, old_sums, old_near, old_apart = partition.explained(
        old_columns, old_weight, costs, costs.reach / old_steps
    )
    none = partition.Sums(np.zeros_like(old_sums.hits), np.zeros_like(old_sums.size))
    counts, first = partition.occupied(weight[:held])
    # An empty hand is one more count, whatever its reading, and far from all others.
    if weight[held] > 0:
        counts, first = np.append(counts, 4 * (held + 1)), np.append(first, len(order))
    poses = partition.candidates(columns, first, counts, costs.weights)
    n, m, rows, inside = len(order), len(counts), len(old_counts), np.empty(len(order), np.bool_)
    row = np.searchsorted(old_counts, old_cells[order]) + 1
    count = np.searchsorted(first, np.arange(n), side="right")
    # Cumulative: entry (r, a) has the particles of the first r readings before and a counts after.
    hits = np.zeros((rows + 1, m + 1, len(poses)), np.int64)
    size = np.zeros((rows + 1, m + 1), np.int64)
    for i in range(n):
        size[row[i], count[i]] += 1
    for k in range(len(poses)):
        within(columns, 0, n, poses[k], costs.weights, inside)
        for i in range(n):
            hits[row[i], count[i], k] += inside[i]
    for r in range(rows):
        hits[r + 1] += hits[r]
        size[r + 1] += size[r]
    for a in range(m):
        hits[:, a + 1] += hits[:, a]
        size[:, a + 1] += size[:, a]
    apart = partition.mutually_apart(poses, costs)
    near = partition.find_near(counts, costs.reach / steps)
    cost = np.full((rows + 1, rows + 1), -1.0)  # of the pieces considered
    cuts, waiting = np.empty(rows + 1, np.int64), np.empty((rows + 1, 2), np.int64)
    left, number = 1, 0
    waiting[0, 0], waiting[0, 1] = 0, rows
    while left > 0:
        left -= 1
        i, j = waiting[left, 0], waiting[left, 1]
        best, at = np.inf, -1
        for s in range(i, j):
            parts = 0.0 if s == i else costs.branch
            for a, b in ((i, s), (s, j)):
                if a == b:
                    continue
                if cost[a, b] < 0.0:
                    p, q = old_near.low[a], old_near.high[b]
                    counted = partition.Sums(hits[b] - hits[a], size[b] - size[a])
                    beside = hits[q] - hits[b] + hits[a] - hits[p]
                    misread = partition.Sums(beside, size[q] - size[b] + size[a] - size[p])
                    further, _ = partition.least_cost(counted, misread, near, apart, costs)
                    most, here, _, wrong = partition.tally(
                        old_sums, none, a, b, old_near, old_apart, costs.modes
                    )
                    open_still, rest = missed(most, here, costs.stopping)
                    ended = costs.stopping.failure * (here * rest + costs.doubt * wrong)
                    squeezed = float(here) + further
                    cost[a, b] = open_still * squeezed + (1.0 - open_still) * max(squeezed, ended)
                parts += cost[a, b]
            if parts < best:
                best, at = parts, s
        if at > i:
            cuts[number] = old_counts[at]
            number += 1
            waiting[left, 0], waiting[left, 1] = i, at
            waiting[left + 1, 0], waiting[left + 1, 1] = at, j
            left += 2
    return end - old_steps * (old_held - cuts[:number])
