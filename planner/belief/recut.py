"""Splits of a branch that the next squeeze shows to be worth it (paper V.A, by value)."""

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.metric import within
from planner.belief.particles import Belief
from planner.belief.partition import (
    CANDIDATES,
    MOST_CELLS,
    Costs,
    Reach,
    Rule,
    Sums,
    candidates,
    explained,
    find_near,
    in_cells,
    into_cells,
    leaf_cost,
    least_cost,
    mutually_apart,
    occupied,
)
from planner.kernel import kernel


def recut(old: Belief, new: Belief, rule: Rule) -> IntArray:
    """The cuts that the readings before a squeeze should have had, given its outcome.

    A rare width beside a common one may look no different until the next squeeze. A piece that meets the goal
    before this squeeze is not squeezed again: it costs at least as much as a leaf.

    Args:
        old: n particles, their readings all of one interval.
        new: the same after the squeeze.
        rule: how readings are cut.

    Returns:
        The first readings of all pieces but the lowest, rising; none where the interval stays whole.
    """
    costs, end = rule.compiled(), int(old.reading.max()) + 1
    before, after = np.empty(len(old), np.int64), np.empty(len(new), np.int64)
    rows, row_steps = into_cells(old.reading, end, costs.coarsest, MOST_CELLS, before)
    held, steps = into_cells(new.reading, costs.free, costs.coarsest, MOST_CELLS, after)
    first, order = (np.argsort(cells, kind="stable") for cells in (before, after))
    cuts = np.empty(rows + 1, np.int64)
    count = _recut(
        np.ascontiguousarray(old.states[first].T),
        np.ascontiguousarray(new.states[order].T),
        before[order],
        np.bincount(after, minlength=held + 1),
        in_cells(costs, held, steps),
        costs.reach / row_steps,
        cuts,
    )
    return end - row_steps * (rows - np.sort(cuts[:count]))


@kernel
def _recut(
    columns_before: Array,
    columns: Array,
    before: IntArray,
    weight: IntArray,
    costs: Costs,
    reach_before: float,
    cuts: IntArray,
) -> int:
    """`recut` in cells, with `cuts` filled in place; returns their number.

    The states `columns_before` (m, n) are sorted by the cell before the squeeze; `columns`, and the cells
    `before` (n,) the squeeze, by the cell after it.
    """
    n, bins = columns.shape[1], weight.shape[0]
    counts, first = np.empty(bins, np.int64), np.zeros(bins + 1, np.int64)
    m = occupied(weight, costs.free, counts, first)
    held = first[m]
    if held < n:  # an empty hand is one more count, whatever its reading, and far from all others
        counts[m], first[m + 1] = 4 * bins, n
        m += 1
    old_weight = np.bincount(before)
    old_bins = old_weight.shape[0]
    old, old_first = np.empty(old_bins, np.int64), np.zeros(old_bins + 1, np.int64)
    rows = occupied(old_weight, old_bins, old, old_first)
    old_first = old_first[: rows + 1]
    place = np.zeros(old_bins, np.int64)
    for r in range(rows):
        place[old[r]] = r
    inside, result = np.empty(n, np.bool_), np.empty((m + CANDIDATES, columns.shape[0]))
    result = result[: candidates(columns, first, counts, m, costs.weights, result)]
    c = result.shape[0]
    # Cumulative over readings before and counts after: rows r.. and counts a.. hold all below both.
    hits, size = np.zeros((rows + 1, m + 1, c), np.int64), np.zeros((rows + 1, m + 1), np.int64)
    for a in range(m):
        for i in range(first[a], first[a + 1]):
            size[place[before[i]] + 1, a + 1] += 1
    for k in range(c):
        within(columns, 0, n, result[k], costs.weights, inside)
        for a in range(m):
            for i in range(first[a], first[a + 1]):
                hits[place[before[i]] + 1, a + 1, k] += inside[i]
    for r in range(1, rows + 1):
        for a in range(1, m + 1):
            size[r, a] += size[r - 1, a] + size[r, a - 1] - size[r - 1, a - 1]
            for k in range(c):
                hits[r, a, k] += hits[r - 1, a, k] + hits[r, a - 1, k] - hits[r - 1, a - 1, k]
    apart = mutually_apart(result if costs.modes > 1 else result[:0], costs.weights)
    start = np.zeros(m + 1, np.int64)
    reach = Reach(np.zeros(m + 1, np.int64), np.zeros(m + 1, np.int64))
    find_near(counts, m, costs.reach, reach)
    old_reach = Reach(np.zeros(rows + 1, np.int64), np.zeros(rows + 1, np.int64))
    find_near(old, rows, reach_before, old_reach)
    old_hits, old_apart = explained(
        columns_before, old_first, old, rows, costs.weights, costs.modes
    )
    old_sums = Sums(old_hits, old_first)
    cost = np.full((rows + 1, rows + 1), -1.0)  # of the pieces considered
    waiting = np.empty((rows + 1, 2), np.int64)
    waiting[0, 0], waiting[0, 1] = 0, rows
    left, count = 1, 0
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
                    p, q = old_reach.low[a], old_reach.high[b]
                    misread = Sums(
                        hits[q] - hits[b] + hits[a] - hits[p],
                        size[q] - size[b] + size[a] - size[p],
                    )
                    counted = Sums(hits[b] - hits[a], size[b] - size[a])
                    left_over = least_cost(counted, misread, reach, apart, costs, start)
                    open_still, ended = leaf_cost(old_sums, a, b, old_reach, old_apart, costs)
                    squeezed = float(old_first[b] - old_first[a]) + left_over
                    cost[a, b] = open_still * squeezed + (1.0 - open_still) * max(squeezed, ended)
                parts += cost[a, b]
            if parts < best:
                best, at = parts, s
        if at > i:
            cuts[count] = old[at]
            count += 1
            waiting[left, 0], waiting[left, 1] = i, at
            waiting[left + 1, 0], waiting[left + 1, 1] = at, j
            left += 2
    return count
