"""Partition of readings into branches: intervals with the least expected cost-to-go (paper V.A, by value).

A plan branches on the encoder's reading. Any two readings that occurred may be separated by a cut. A set of
cuts costs

    sum over intervals z of  P(z) J(b_z)  +  doubt * sum over cuts of P(a reading within `reach` of the cut)

where J(b) is the cost-to-go of the particles read in the interval. It is lower the fewer poses they lie at,
so that widths of one grasp are cut off from rarer ones beside them.
The second sum keeps cuts away from readings that occur: an encoder a little off would take such parts into
the wrong branch. Dynamic programming finds the cuts of least cost.

For all intervals at once, the share of one pose is found from a list of candidate poses: how many particles
each has within the goal at every count is summed over cells once. Readings of an empty hand (the part
slipped out or was never touched) are always an interval of their own.

A cell is one step of the encoder, or several where a belief spreads over more than `MOST_CELLS` steps: the
resolution does not increase the arrays, nor the time, which is quadratic in their size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.metric import Metric, inliers, within
from planner.belief.observation import Resolution
from planner.belief.stopping import StoppingRule, missed
from planner.kernel import inner_kernel, kernel

MOST_CELLS = 128  # of a belief, unless cells would be needlessly coarse
CANDIDATES = 48  # candidate poses of a belief, besides one for each cell
CLIMBS = 2  # mean-shift steps of each candidate


class Rule(NamedTuple):
    """How readings are cut into branches.

    Attributes:
        metric: of the goal.
        stopping: the rule for located branches, and the leaf heuristic.
        resolution: of the encoder.
        doubt: probability that a part near a cut strays into a leaf beyond it; a larger value gives fewer
            wrong answers where encoders are off, and more squeezes.
        astray: cost of a part that strays into a branch that is squeezed again [squeezes]; a larger value
            has the same effects.
        branch: cost of an interval [squeezes of one particle]; a larger value gives smaller tables, a smaller
            one fits noise.
        reach: distance within which a reading counts as near a cut [grains of the encoder].
    """

    metric: Metric
    stopping: StoppingRule
    resolution: Resolution
    doubt: float = 0.05
    astray: float = 0.3
    branch: float = 8.0
    reach: float = 2.7

    def compiled(self) -> Costs:
        """The rule in the form that kernels read."""
        metric, resolution = self.metric, self.resolution
        prices = (self.doubt, self.astray, self.branch, self.reach * resolution.grain)
        stopping = StoppingRule(*map(float, self.stopping))
        return Costs(
            resolution.free,
            resolution.coarsest,
            metric.weights(),
            metric.modes,
            stopping,
            *map(float, prices),
        )


class Costs(NamedTuple):
    """A `Rule` for kernels, in cells. All but counts are floats, so that kernels compile once."""

    free: int  # least cell that an empty hand reads
    coarsest: int  # steps that a cell may have
    weights: Array  # of the metric
    modes: int  # most modes of a belief
    stopping: StoppingRule
    doubt: float
    astray: float
    branch: float
    reach: float


class Sums(NamedTuple):
    """Cumulative numbers of particles over m counts."""

    hits: IntArray  # (m + 1, c) particles within the goal of each candidate
    size: IntArray  # (m + 1,) all particles


class Reach(NamedTuple):
    """The counts near a cut among m ascending ones; an encoder a little off may read them across it."""

    low: IntArray  # (m + 1,) the first count within reach of the i-th
    high: IntArray  # (m + 1,) the first count beyond reach of the one before the j-th


def partition(poses: Array, readings: IntArray, rule: Rule) -> IntArray:
    """Cuts readings into the intervals of least expected cost-to-go.

    Args:
        poses: (n, 3 or 4) states after the squeeze, n >= 1 [mm, mm, rad, hypothesis].
        readings: (n,).
        rule: how they are cut.

    Returns:
        (n,) the interval of each, numbered from 0 in the order of rising width.
    """
    costs, cells = rule.compiled(), np.empty(len(readings), np.int64)
    held, steps = into_cells(readings, costs.free, costs.coarsest, MOST_CELLS, cells)
    weight = np.bincount(cells, minlength=held + 1)
    order = np.argsort(cells, kind="stable")
    bounds = np.empty(held + 2, np.int64)
    columns = np.ascontiguousarray(poses[order].T)
    k = intervals(columns, weight, in_cells(costs, held, steps), bounds)
    return np.asarray(k - np.searchsorted(bounds[k::-1], cells, side="right"))


@kernel
def into_cells(
    readings: IntArray, free: int, coarsest: int, most: int, cells: IntArray
) -> tuple[int, int]:
    """Replaces readings (n,) by equal cells, in place; returns the number of cells and their steps.

    Readings of held parts, below `free`, take at most `most` cells, unless a cell would exceed `coarsest`
    steps; readings of an empty hand are the cell after these.
    """
    lowest = free
    for reading in readings:
        lowest = min(lowest, reading)
    steps = min(max(-(-(free - lowest) // most), 1), coarsest)
    held = -(-(free - lowest) // steps)
    for i in range(readings.shape[0]):
        below = free - 1 - readings[i]
        cells[i] = held if below < 0 else held - 1 - below // steps
    return held, steps


@kernel
def in_cells(costs: Costs, held: int, steps: int) -> Costs:
    """The costs in cells of several steps, for readings replaced by `into_cells`."""
    return Costs(
        held,
        costs.coarsest,
        costs.weights,
        costs.modes,
        costs.stopping,
        costs.doubt,
        costs.astray,
        costs.branch,
        costs.reach / steps,
    )


@kernel
def candidates(
    columns: Array, first: IntArray, counts: IntArray, m: int, weights: Array, poses: Array
) -> int:
    """Fills `poses` (c, .) with poses that explain many particles about a count; returns c."""
    n, width, c = first[m], columns.shape[0], 0
    mean, centre, inside = np.empty(width), np.empty(width), np.empty(n, np.bool_)
    for a in range(m):
        low, high = first[a], first[a + 1]
        if a > 0 and counts[a - 1] == counts[a] - 1:
            low = first[a - 1]
        if a + 1 < m and counts[a + 1] == counts[a] + 1:
            high = first[a + 2]
        size = first[a + 1] - first[a]
        wanted = min(size, 1 + CANDIDATES * size // n)
        for k in range(wanted):
            centre[:] = columns[:, first[a] + k * size // wanted]
            best = 0
            for _ in range(CLIMBS + 1):
                hits = inliers(columns, low, high, centre, weights, inside, mean)
                if hits <= best:
                    break
                best = hits
                poses[c] = centre
                centre[:] = mean
            c += 1
    return c


@kernel
def explained(
    columns: Array, first: IntArray, counts: IntArray, m: int, weights: Array, modes: int
) -> tuple[IntArray, BoolArray]:
    """Cumulative counts (m + 1, c) of particles within the goal of each candidate; mask of those apart."""
    result, inside = np.empty((m + CANDIDATES, columns.shape[0])), np.empty(first[m], np.bool_)
    result = result[: candidates(columns, first, counts, m, weights, result)]
    hits = np.zeros((m + 1, result.shape[0]), np.int64)
    for c in range(result.shape[0]):
        within(columns, 0, first[m], result[c], weights, inside)
        for a in range(m):
            hits[a + 1, c] = hits[a, c] + inside[first[a] : first[a + 1]].sum()
    return hits, mutually_apart(result if modes > 1 else result[:0], weights)


@kernel
def _best(hits: IntArray, i: int, j: int, modes: int, apart: BoolArray) -> tuple[int, int]:
    """Number of particles of counts i to j - 1 within the goal of the best candidates, and which is the best.

    The latter is -1 where the goal allows several modes.
    """
    if modes > 1:
        return _best_modes(hits, i, j, modes, apart), -1
    best, chosen = 0, 0
    for k in range(hits.shape[1]):
        best = max(best, hits[j, k] - hits[i, k])
    while hits[j, chosen] - hits[i, chosen] < best:
        chosen += 1
    return best, chosen


@kernel
def leaf_cost(
    counted: Sums, i: int, j: int, reach: Reach, apart: BoolArray, costs: Costs
) -> tuple[float, float]:
    """Probability that counts i to j - 1 miss the goal, and the cost of a leaf; arguments as `least_cost`."""
    hits, size, low, high = counted.hits, counted.size, reach.low, reach.high
    stopping = costs.stopping
    best, chosen = _best(hits, i, j, costs.modes, apart)
    here = size[j] - size[i]
    open_still, rest = missed(best, here, stopping.confidence, stopping.inside, stopping.outside)
    wrong = size[high[j]] - size[j] + size[i] - size[low[i]]
    if chosen >= 0:
        wrong -= hits[high[j], chosen] - hits[j, chosen] + hits[i, chosen] - hits[low[i], chosen]
    return open_still, stopping.failure * (here * rest + costs.doubt * wrong)


@kernel
def least_cost(
    counted: Sums, misread: Sums, reach: Reach, apart: BoolArray, costs: Costs, start: IntArray
) -> float:
    """The least cost of cutting particles of m counts into intervals; `start` receives the cuts.

    Args:
        counted: the particles.
        misread: the particles that are read here only if the encoder is off.
        reach: which counts are near a cut.
        apart: (c, c) pairs of candidates that no particle can be near at once; empty for one mode.
        costs: of branches and leaves.
        start: (m + 1,) receives where the last interval of the first j counts begins.
    """
    hits, size, low, high = counted.hits, counted.size, reach.low, reach.high
    m = size.shape[0] - 1
    least = np.full(m + 1, np.inf)
    least[0] = 0.0
    stopping, failure = costs.stopping, costs.stopping.failure
    doubt, astray, branch = costs.doubt, costs.astray, costs.branch
    for i in range(m):
        if size[i + 1] == size[i]:
            least[i + 1] = min(least[i + 1], least[i])  # nothing there
            continue
        for j in range(i + 1, m + 1):
            here = size[j] - size[i]
            strange = size[high[j]] - size[j] + size[i] - size[low[i]]
            strange += misread.size[j] - misread.size[i]
            best, chosen = _best(hits, i, j, costs.modes, apart)
            wrong = strange
            if chosen >= 0:
                wrong -= (
                    hits[high[j], chosen] - hits[j, chosen] + hits[i, chosen] - hits[low[i], chosen]
                )
                wrong -= misread.hits[j, chosen] - misread.hits[i, chosen]
            open_still, rest = missed(
                best, here, stopping.confidence, stopping.inside, stopping.outside
            )
            further = 2.0 - best / here
            left = open_still * further + (1.0 - open_still) * min(failure * rest, further)
            harm = astray * open_still * strange + (1.0 - open_still) * failure * doubt * wrong
            cost = least[i] + branch + here * left + harm
            if cost < least[j]:
                least[j], start[j] = cost, i
    return float(least[m])


@inner_kernel
def find_near(counts: IntArray, m: int, distance: float, reach: Reach) -> None:
    """Fills in `reach` for m ascending counts and a distance [counts]."""
    low, high = reach.low, reach.high
    for i in range(m + 1):
        low[i], high[i] = i, i
        while i < m and low[i] > 0 and counts[i] - counts[low[i] - 1] <= distance:
            low[i] -= 1
        while i > 0 and high[i] < m and counts[high[i]] - counts[i - 1] <= distance:
            high[i] += 1


@inner_kernel
def occupied(weight: IntArray, stop: int, counts: IntArray, first: IntArray) -> int:
    """Fills in the m counts below `stop` that occur, and the cumulative number of readings; returns m."""
    m = 0
    first[0] = 0
    for count in range(min(stop, weight.shape[0])):
        if weight[count] > 0:
            counts[m] = count
            first[m + 1] = first[m] + weight[count]
            m += 1
    return m


@kernel
def intervals(columns: Array, weight: IntArray, costs: Costs, bounds: IntArray) -> int:
    """Fills in the bounds (k + 1,) of the intervals, descending; returns k.

    The states stand in columns, by ascending count. Interval j has counts from bounds[j + 1] up to bounds[j].
    """
    n, free = weight.shape[0], costs.free
    counts, first = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    m = occupied(weight, free, counts, first)
    hits, apart = explained(columns, first, counts, m, costs.weights, costs.modes)
    start = np.zeros(m + 1, np.int64)
    reach = Reach(np.zeros(m + 1, np.int64), np.zeros(m + 1, np.int64))
    find_near(counts, m, costs.reach, reach)
    none = Sums(np.zeros_like(hits), np.zeros(m + 1, np.int64))
    least_cost(Sums(hits, first[: m + 1]), none, reach, apart, costs, start)
    k = 0
    if weight[max(free, 0) :].sum() > 0:
        bounds[0] = n
        k = 1
    bounds[k] = min(free, n)
    j = m
    while j > 0:
        j = start[j]
        k += 1
        bounds[k] = counts[j]
    return k


@kernel
def mutually_apart(poses: Array, weights: Array) -> BoolArray:
    """(c, c) whether no particle can be within the goal of both candidates."""
    c = poses.shape[0]
    half = np.copy(weights)
    half[:, 1:4] *= 0.5
    columns = np.ascontiguousarray(poses.T)
    near = np.zeros((c, c), np.bool_)
    for a in range(c):
        within(columns, 0, c, poses[a], half, near[a])
    return ~near


@kernel
def _best_modes(hits: IntArray, i: int, j: int, modes: int, apart: BoolArray) -> int:
    """Particles of counts i to j - 1 within the goal of the best candidates, all of them apart."""
    c, total = hits.shape[1], 0
    chosen = np.empty(modes, np.int64)
    for mode in range(modes):
        best = 0
        for k in range(c):
            here = hits[j, k] - hits[i, k]
            if here <= best:
                continue
            clear = True
            for other in range(mode):
                clear = clear and apart[k, chosen[other]]
            if clear:
                best = here
                chosen[mode] = k
        if best == 0:
            break
        total += best
    return total
