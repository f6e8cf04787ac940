"""Partition of readings into branches: intervals with the least expected cost-to-go.

The paper (V.A) clusters readings instead.

A plan branches on the encoder's reading. Any two readings that occurred may be separated by a cut. A set of
cuts costs

    sum over intervals z of  P(z) J(b_z)  +  doubt * sum over cuts of P(a reading within `reach` of the cut)

where J(b) is the cost-to-go of the particles read in the interval, and the price `doubt` weighs the second
sum. J is low where most particles of an interval lie at one pose, so it pays to cut between the widths of one
pose and rarer widths of other poses beside them. The second sum keeps cuts away from readings that occur: an
encoder a little off would take such parts into the wrong branch. Dynamic programming finds the cuts of least
cost.

The share of an interval's particles that lie at one pose is found from a list of candidate poses. For each
candidate the particles within its goal are counted once, as running totals over cells of readings; the count
in an interval is the difference of two totals. Readings of an empty hand (the part slipped out or was never
touched) are always an interval of their own.

A cell is one step of the encoder, or several where a belief spreads over more than `MOST_CELLS` steps. This
limits the arrays for encoders of any resolution, and with them the time, which is quadratic in their size.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.metric import Metric, inliers, within
from planner.belief.observation import Resolution
from planner.belief.stopping import StoppingRule, missed
from planner.kernel import kernel

MOST_CELLS = 128  # most cells of a belief, unless a cell would be coarser than the rule allows
CANDIDATES = 48  # candidate poses of a belief, besides one for each cell
CLIMBS = 2  # mean-shift steps of each candidate


class Rule(NamedTuple):
    """How readings are cut into branches.

    Attributes:
        metric: the metric of the goal.
        stopping: the rule for located branches, and the leaf heuristic.
        resolution: the resolution of the encoder.
        doubt: probability that a part near a cut strays into a leaf beyond it; a larger value gives fewer
            wrong answers where encoders are off, and more squeezes.
        astray: cost of a part that strays into a branch after which another squeeze follows [squeezes]; a
            larger value has the same effects as a larger `doubt`.
        branch: cost of one interval, in units of one squeeze of one particle; a larger value gives smaller
            tables, a smaller one fits noise.
        reach: distance within which a reading counts as near a cut, in units of the scatter
            `Resolution.grain`.
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
        (_, free, _, grain, coarsest), metric = self.resolution, self.metric
        prices = map(float, (self.doubt, self.astray, self.branch, self.reach * grain))
        stopping = StoppingRule(*map(float, self.stopping))
        return Costs(free, coarsest, metric.weights(), metric.modes, stopping, *prices)


class Costs(NamedTuple):
    """The parameters of a `Rule` as plain numbers and arrays, for kernels.

    All but counts are floats, so that kernels compile once.
    """

    free: int  # least reading of an empty hand
    coarsest: int  # most steps of a cell
    weights: Array  # weights of the metric
    modes: int  # most modes of a belief
    stopping: StoppingRule
    doubt: float
    astray: float
    branch: float
    reach: float  # distance near a cut [steps of the encoder]


class Sums(NamedTuple):
    """Running totals over the m encoder counts that occur: row i has the particles of the i lowest counts."""

    hits: IntArray  # (m + 1, c) particles within the goal of each candidate
    size: IntArray  # (m + 1,) all particles


class Reach(NamedTuple):
    """The counts within reach of each possible cut, as index ranges; the m counts are in ascending order.

    An encoder that is slightly off may read such a count on the other side of the cut.
    """

    low: IntArray  # (m + 1,) index of the first count within reach of count i
    high: IntArray  # (m + 1,) index of the first count beyond reach of count j - 1


def partition(poses: Array, readings: IntArray, rule: Rule) -> IntArray:
    """Cuts readings into the intervals of least expected cost-to-go.

    Args:
        poses: (n, 3 or 4) states after the squeeze, n >= 1 [mm, mm, rad, hypothesis].
        readings: (n,) readings of the encoder.
        rule: how the readings are cut.

    Returns:
        (n,) the interval of each, numbered from 0 in the order of rising width.
    """
    return interval_of_each(poses, readings, rule.compiled())


@kernel
def interval_of_each(states: Array, readings: IntArray, costs: Costs) -> IntArray:
    """Compiled form of `partition`: the interval (n,) of each reading."""
    cells, held, steps = into_cells(readings, costs.free, costs.coarsest)
    columns, weight, _ = by_group(states, cells, held + 1)
    counts, sums, near, apart = explained(columns, weight[:held], costs, costs.reach / steps)
    none = Sums(np.zeros_like(sums.hits), np.zeros_like(sums.size))
    _, start = least_cost(sums, none, near, apart, costs)
    interval, number = np.zeros(held + 1, np.int64), int(weight[held] > 0)  # of each cell
    stop = len(counts)
    while stop > 0:
        interval[counts[start[stop]] : counts[stop - 1] + 1] = number
        number += 1
        stop = start[stop]
    return interval[cells]


@kernel
def into_cells(readings: IntArray, free: int, coarsest: int) -> tuple[IntArray, int, int]:
    """Groups readings (n,) into cells of several steps of the encoder.

    Readings of held parts, which are below `free`, take at most `MOST_CELLS` cells, unless a cell would
    exceed `coarsest` steps. Readings of an empty hand are in one more cell after these.

    Returns:
        The cell (n,) of each reading, the number of cells of held parts, and the steps of such a cell.
    """
    lowest = min(free, readings.min())
    steps = min(max(-(-(free - lowest) // MOST_CELLS), 1), coarsest)
    held = -(-(free - lowest) // steps)
    below = free - 1 - readings
    return np.where(below < 0, held, held - 1 - below // steps), held, steps


@kernel
def by_group(states: Array, group: IntArray, groups: int) -> tuple[Array, IntArray, IntArray]:
    """Sorts states (n, m) by their group (n,), stably.

    Returns:
        The states in columns (m, n), the size (groups,) of each group, and the order (n,) of the states.
    """
    size = np.bincount(group, minlength=groups)
    place, order = np.cumsum(size) - size, np.empty_like(group)
    for i in range(group.shape[0]):
        order[place[group[i]]] = i
        place[group[i]] += 1
    return np.ascontiguousarray(states[order].T), size, order


@kernel
def candidates(columns: Array, first: IntArray, counts: IntArray, weights: Array) -> Array:
    """Candidate poses (c, m), found by mean shift among particles of nearly the same count.

    Each has many of these particles within the goal.

    Args:
        columns: (m, n) states, sorted by count of the encoder.
        first: (k + 1,) index of the first state of each count, then n.
        counts: (k,) counts that occur, in ascending order.
        weights: weights of the metric.
    """
    n, m, width, c = first[-1], counts.shape[0], columns.shape[0], 0
    poses = np.empty((m + CANDIDATES, width))
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
    return poses[:c]


@kernel
def explained(
    columns: Array, weight: IntArray, costs: Costs, reach: float
) -> tuple[IntArray, Sums, Reach, BoolArray]:
    """Sums the particles within the goal of each candidate pose.

    Args:
        columns: (m, n) states, sorted by count.
        weight: number of states with each count.
        costs: costs of branches and leaves.
        reach: distance within which counts are near a cut.

    Returns:
        The counts that occur, the sums over them, which counts are near each cut, and which candidates are
        mutually apart.
    """
    counts, first = occupied(weight)
    poses, inside = candidates(columns, first, counts, costs.weights), np.empty(first[-1], np.bool_)
    hits = np.zeros((first.shape[0], poses.shape[0]), np.int64)
    for c in range(poses.shape[0]):
        within(columns, 0, first[-1], poses[c], costs.weights, inside)
        for a in range(counts.shape[0]):
            hits[a + 1, c] = hits[a, c] + inside[first[a] : first[a + 1]].sum()
    return counts, Sums(hits, first), find_near(counts, reach), mutually_apart(poses, costs)


@kernel
def _best(hits: IntArray, i: int, j: int, modes: int, apart: BoolArray) -> tuple[int, int]:
    """Finds the best candidate: the one with most particles of counts i to j - 1 within the goal.

    Returns the number of these particles, and the index of the candidate. If the goal allows several modes,
    the number is for the best `modes` candidates together, and the index is -1.
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
def tally(
    counted: Sums, misread: Sums, i: int, j: int, reach: Reach, apart: BoolArray, modes: int
) -> tuple[int, int, int, int]:
    """Numbers of particles for an interval of counts i to j - 1; see `least_cost` for the arguments.

    Returns:
        Particles within the goal of the interval's best candidates; all particles of the interval; particles
        of other intervals that may stray into it; and how many of these strays are outside the goal. If the
        goal allows several modes, all strays count as outside.
    """
    hits, size, low, high = counted.hits, counted.size, reach.low, reach.high
    best, chosen = _best(hits, i, j, modes, apart)
    strange = size[high[j]] - size[j] + size[i] - size[low[i]]
    strange += misread.size[j] - misread.size[i]
    wrong = strange
    if chosen >= 0:
        wrong -= hits[high[j], chosen] - hits[j, chosen] + hits[i, chosen] - hits[low[i], chosen]
        wrong -= misread.hits[j, chosen] - misread.hits[i, chosen]
    return best, size[j] - size[i], strange, wrong


@kernel
def least_cost(
    counted: Sums, misread: Sums, reach: Reach, apart: BoolArray, costs: Costs
) -> tuple[float, IntArray]:
    """Cuts the m counts that occur into intervals at the least cost.

    Args:
        counted: the particles.
        misread: further particles that have these readings only if the encoder is off.
        reach: which counts are near a cut.
        apart: (c, c) pairs of candidates that no particle can be near at once; empty for one mode.
        costs: costs of branches and leaves.

    Returns:
        The cost, and an array (m + 1,): entry j is the index of the count at which the last interval begins
        if only the first j counts are cut.
    """
    m, failure = counted.size.shape[0] - 1, costs.stopping.failure
    least, start = np.full(m + 1, np.inf), np.zeros(m + 1, np.int64)
    least[0] = 0.0
    for i in range(m):
        if counted.size[i + 1] == counted.size[i]:
            least[i + 1] = min(least[i + 1], least[i])  # nothing there
            continue
        for j in range(i + 1, m + 1):
            best, here, strange, wrong = tally(counted, misread, i, j, reach, apart, costs.modes)
            open_still, rest = missed(best, here, costs.stopping)
            further = 2.0 - best / here
            left = open_still * further + (1.0 - open_still) * min(failure * rest, further)
            astray = costs.astray * open_still * strange
            harm = astray + (1.0 - open_still) * failure * costs.doubt * wrong
            cost = least[i] + costs.branch + here * left + harm
            if cost < least[j]:
                least[j], start[j] = cost, i
    return least[m], start


@kernel
def find_near(counts: IntArray, distance: float) -> Reach:
    """For each place where the ascending counts (m,) of an encoder may be cut, finds the counts near it.

    These are at most `distance` [counts] from the place.
    """
    m = counts.shape[0]
    low, high = np.arange(m + 1), np.zeros(m + 1, np.int64)
    low[:m] = np.searchsorted(counts, counts - int(distance))
    high[1:] = np.searchsorted(counts, counts + int(distance), side="right")
    return Reach(low, high)


@kernel
def occupied(weight: IntArray) -> tuple[IntArray, IntArray]:
    """Returns the m counts with at least one reading, and the number (m + 1,) of readings below each of them.

    The last entry is the number of all readings. `weight` has the number of readings of each count.
    """
    counts = np.flatnonzero(weight)
    first = np.zeros(len(counts) + 1, np.int64)
    first[1:] = np.cumsum(weight[counts])
    return counts, first


@kernel
def mutually_apart(poses: Array, costs: Costs) -> BoolArray:
    """Mask (c, c) of the pairs of candidates so far apart that no particle is within the goal of both.

    The mask is empty if the goal allows only one mode.
    """
    c, half = poses.shape[0] if costs.modes > 1 else 0, np.copy(costs.weights)
    half[:, 1:4] *= 0.5
    columns = np.ascontiguousarray(poses.T)
    near = np.zeros((c, c), np.bool_)
    for a in range(c):
        within(columns, 0, c, poses[a], half, near[a])
    return ~near


@kernel
def _best_modes(hits: IntArray, i: int, j: int, modes: int, apart: BoolArray) -> int:
    """Number of particles, read as counts i to j - 1, within the goal of one of the best candidates.

    There are at most `modes` such candidates, of which each two are apart.
    """
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
