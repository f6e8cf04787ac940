"""Readings of the encoder, and their clusters by k-means (paper V.A).

The finger encoder is a linear map of the gripper with noise. The paper's method partitions widths by k-means,
solved exactly by dynamic programming over their histogram, as one dimension allows (the planner's own way is
`planner.belief.partition`). k is the smallest number of clusters within which widths scatter little enough:

- a cluster that has a hole in it, much wider than the distance that separates two clusters, is cut there: a
  rare outcome far from the others is an outcome of its own, and no width in between is taken for either;
- neighbouring clusters whose means the encoder cannot tell apart are merged, and the merges recorded;
- readings of an empty hand (the part slipped out or was never touched) are always a cluster of their own.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array, IntArray
from planner.job.model import Job
from planner.kernel import kernel

MOST_CLUSTERS = 10  # clusters of k-means; holes may cut them further
SIGMAS = 6.0
"""Standard deviations by which readings of two distinguishable widths differ (0.3 % mistaken)."""
HOLE = 2.0  # width of a hole that cuts a cluster, in units of the distance that separates two
LEAST_CUT = 20
"""Least readings on either side of a hole: with fewer it may be chance, and the piece is too small."""
COARSE_MM = 0.4  # widths that the search may merge where there are very many
MARGIN_MM = 1.0
"""Distance beyond the widths seen that a branch reaches, at most half a gap."""


@dataclass(frozen=True, slots=True)
class Encoder:
    """A linear encoder with noise. A reading is a number of steps of closing: 0 open, `steps` closed."""

    opening_mm: float  # width at reading 0
    steps: int  # of its resolution, from open to closed
    noise_mm: float  # standard deviation of a measured width before its rounding

    @property
    def mm_per_step(self) -> float:
        """Width of one step."""
        return self.opening_mm / self.steps

    @property
    def grain_mm(self) -> float:
        """Scatter of the readings of one width: the resolution, or the noise where that is larger."""
        return max(self.mm_per_step, self.noise_mm)

    def read(self, width_mm: Array, rng: np.random.Generator) -> IntArray:
        """Noisy readings of true widths, clipped at both ends of travel."""
        noisy = width_mm + self.noise_mm * rng.standard_normal(np.shape(width_mm))
        readings = np.rint(self.steps - noisy / self.mm_per_step)
        return np.asarray(np.clip(readings, 0, self.steps), dtype=np.int64)

    def with_flag(self, readings: IntArray, width_mm: Array) -> IntArray:
        """Readings (n,) with the object flag added, which distinguishes thin grips from an empty hand."""
        held = np.minimum(readings, resolution_of(self).free - 1)
        return np.where(width_mm > 0.0, held, readings)

    def width_mm(self, readings: Array | IntArray) -> Array:
        """The width in the middle of a reading's interval; fractional readings are allowed."""
        return np.asarray((self.steps - np.asarray(readings, dtype=np.float64)) * self.mm_per_step)

    def width_um(self, readings: IntArray) -> IntArray:
        """Width at a reading, rounded to the micrometres that a driver reports and a table looks up."""
        opening_um = round(1e3 * self.opening_mm)
        closed = self.steps - np.asarray(readings, np.int64)
        return np.asarray((2 * opening_um * closed + self.steps) // (2 * self.steps))


def encoder_of(job: Job) -> Encoder:
    """The encoder of a job's gripper."""
    gripper = job.gripper
    return Encoder(gripper.opening_mm, gripper.profile.steps, gripper.noise_mm)


class Resolution(NamedTuple):
    """The distances that an encoder can resolve, in steps."""

    apart: float = 3.0  # least distance of two cluster means
    free: int = 225  # least reading of an empty hand
    margin: int = 3  # steps beyond those read that a branch takes
    grain: float = 1.0  # scatter of the readings of one width, at least a step
    coarsest: int = 1  # steps that the search may merge


class Partition(NamedTuple):
    """Clusters of readings, in the order of rising width: falling readings."""

    mean: Array  # (k,) mean reading of each cluster
    low: IntArray  # (k,) least reading in it
    high: IntArray  # (k,) greatest reading in it
    size: IntArray  # (k,) how many readings it holds

    @classmethod
    def of(cls, readings: Sequence[IntArray]) -> Self:
        """The clusters of n >= 1 readings, given the cluster of each."""
        return cls(
            mean=np.array([each.mean() for each in readings]),
            low=np.array([each.min() for each in readings]),
            high=np.array([each.max() for each in readings]),
            size=np.array([len(each) for each in readings]),
        )

    def of_clusters(self, numbers: Sequence[int]) -> Self:
        """A subset of the clusters, renumbered."""
        rows = np.array(numbers, np.int64)
        return type(self)(self.mean[rows], self.low[rows], self.high[rows], self.size[rows])


def resolution_of(encoder: Encoder) -> Resolution:
    """The resolution of an encoder with its noise."""
    step_mm = encoder.mm_per_step
    noise = encoder.noise_mm / step_mm
    return Resolution(
        apart=max(SIGMAS * math.sqrt(noise**2 + 1.0 / 12.0), 3.0),
        free=encoder.steps - math.ceil(0.5 * SIGMAS * noise),
        margin=math.ceil(MARGIN_MM / step_mm),
        grain=encoder.grain_mm / step_mm,
        coarsest=max(1, int(COARSE_MM / step_mm)),
    )


def cut(
    weight: IntArray, free: int, spread: float, within: float, apart: float, hole: float
) -> tuple[IntArray, Array]:
    """Cuts a histogram of readings into clusters. Lengths are in its bins; widths fall as bins rise.

    Args:
        weight: (n,) readings of each bin.
        free: least bin of an empty hand.
        spread: accepted root mean square spread within clusters.
        within: accepted share of the variance of held parts within clusters.
        apart: least distance of two means; clusters nearer than that are merged.
        hole: width of a hole that cuts a cluster.

    Returns:
        (k + 1,) the bounds of the clusters, falling: cluster j has the bins from bounds[j + 1] to
        bounds[j] - 1; and (m, 2) the means of the pairs merged.
    """
    n = len(weight)
    bounds, merged = np.empty(n + 1, np.int64), np.empty((n, 2))
    k, merges = _bounds(weight, free, spread, within, apart, hole, bounds, merged)
    return bounds[: k + 1], merged[:merges]


@kernel
def _bounds(
    weight: IntArray,
    free: int,
    spread: float,
    within: float,
    apart: float,
    hole: float,
    bounds: IntArray,
    merged: Array,
) -> tuple[int, int]:
    """`cut` into `bounds` (n + 1,) and `merged` (n, 2); returns the numbers of clusters and merges."""
    n = weight.shape[0]
    values, m = np.empty(n, np.int64), 0
    for count in range(min(free, n)):
        if weight[count] > 0:
            values[m] = count
            m += 1
    first = np.zeros(n + 1, np.int64)  # first bin of each cluster of held parts, ascending
    k = 0
    if m > 0:
        k = _k_means(weight, values[:m], spread, within, first)
        k = _cut_holes(weight, values[:m], hole, first, k)
    k, merges = _merge_near(weight, free, apart, first, k, merged)
    empty = 0
    for count in range(max(free, 0), n):
        empty += weight[count]
    bounds[0] = n if empty > 0 else min(free, n)
    row = 0
    if empty > 0:
        bounds[1] = free
        row = 1
    for j in range(k):
        bounds[row + 1 + j] = first[k - 1 - j]
    return k + row, merges


@kernel
def _k_means(
    weight: IntArray, values: IntArray, spread: float, within: float, first: IntArray
) -> int:
    """Exact k-means for the smallest k of an accepted spread.

    Args:
        weight: (n,) readings of each bin.
        values: (m,) the bins that occur, rising.
        spread: see `cut`.
        within: see `cut`.
        first: receives the first bin of each cluster.

    Returns:
        k.
    """
    m = values.shape[0]
    w, s, q = np.zeros(m + 1), np.zeros(m + 1), np.zeros(m + 1)
    for i in range(m):
        # Relative to the first value, against cancellation.
        x = float(values[i] - values[0])
        w[i + 1] = w[i] + weight[values[i]]
        s[i + 1] = s[i] + weight[values[i]] * x
        q[i + 1] = q[i] + weight[values[i]] * x * x
    most = min(m, MOST_CLUSTERS)
    reach, last = (
        np.empty(m + 1),
        np.empty(m + 1),
    )  # least cost of the first j values in k and in k - 1
    split = np.zeros((most + 1, m + 1), np.int64)
    for j in range(1, m + 1):
        reach[j] = q[j] - s[j] * s[j] / w[j]
    enough = max(spread * spread * w[m], within * reach[m])
    k = 1
    while k < most and reach[m] > enough:
        k += 1
        last, reach = reach, last  # entries left over from two rounds before are never read
        for j in range(k, m + 1):
            best = np.inf
            for i in range(k - 1, j):
                dw, ds = w[j] - w[i], s[j] - s[i]
                cost = last[i] + max(q[j] - q[i] - ds * ds / dw, 0.0)
                if cost < best:
                    best = cost
                    split[k, j] = i
            reach[j] = best
    j = m
    for cluster in range(k, 0, -1):
        j = split[cluster, j]
        first[cluster - 1] = values[j]
    return k


@kernel
def _cut_holes(weight: IntArray, values: IntArray, hole: float, first: IntArray, k: int) -> int:
    """Cuts every cluster at its holes that have enough readings on both sides, in place; returns k."""
    c = k - 1
    stop = values[-1] + 1
    while c >= 0:
        total = 0
        for count in range(first[c], stop):
            total += weight[count]
        above, upper = 0, stop
        for count in range(stop - 1, first[c] - 1, -1):
            if weight[count] == 0:
                continue
            if upper - count >= hole and min(above, total - above) >= LEAST_CUT:
                for j in range(k, c + 1, -1):
                    first[j] = first[j - 1]
                first[c + 1] = upper
                k += 1
                total -= above
                above = 0
            above += weight[count]
            upper = count
        stop = first[c]
        c -= 1
    return k


@kernel
def _merge_near(
    weight: IntArray, free: int, apart: float, first: IntArray, k: int, merged: Array
) -> tuple[int, int]:
    """Merges the nearest clusters in place while their means are too near; returns k and merges."""
    mean = np.empty(max(k, 1))
    merges = 0
    while k > 1:
        for c in range(k):
            stop = first[c + 1] if c + 1 < k else free
            total, moment = 0.0, 0.0
            for count in range(first[c], stop):
                total += weight[count]
                moment += weight[count] * count
            mean[c] = moment / total
        nearest = 0
        for c in range(1, k - 1):
            if mean[c + 1] - mean[c] < mean[nearest + 1] - mean[nearest]:
                nearest = c
        if mean[nearest + 1] - mean[nearest] >= apart:
            break
        merged[merges, 0], merged[merges, 1] = mean[nearest], mean[nearest + 1]
        merges += 1
        k -= 1
        for c in range(nearest + 1, k):
            first[c] = first[c + 1]
    return k, merges
