"""The partition of outcomes by width: k-means on encoder counts (paper V.A).

In one dimension k-means is solved exactly by dynamic programming over the histogram of counts. k is the
smallest number of clusters within which widths scatter no more than the encoder does; clusters whose means
the encoder cannot tell apart are not made.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.encoder import COUNTS

SPREAD_COUNTS = 1.6
"""Root mean square spread within clusters at which no more are made [counts]."""
APART_COUNTS = 3.0
"""Least distance of two cluster means [counts]: nearer ones share too many readings (planning at 0.37 mm)."""
MOST_CLUSTERS = 10


class Partition(NamedTuple):
    """Clusters of counts, in the order of rising width: falling counts.

    Attributes:
        label: (256,) cluster of each count, -1 for counts never read.
        mean: (k,) mean count of each cluster.
        low: (k,) least count read in it.
        high: (k,) greatest count read in it.
        size: (k,) how many readings it holds.
    """

    label: IntArray
    mean: Array
    low: IntArray
    high: IntArray
    size: IntArray


def partition(counts: IntArray) -> Partition:
    """Clusters encoder counts.

    Args:
        counts: (n,) readings, 0 to 255, n >= 1.
    """
    weight = np.bincount(counts, minlength=COUNTS)
    values = np.flatnonzero(weight)
    bounds = _best_bounds(values.astype(np.float64), weight[values].astype(np.float64))
    label = np.full(COUNTS, -1, np.int64)
    mean, low, high, size = [], [], [], []
    segments = list(pairwise(bounds))
    for k, (start, stop) in enumerate(reversed(segments)):
        members = values[start:stop]
        label[members] = k
        mean.append(float(np.average(members, weights=weight[members])))
        low.append(int(members[0]))
        high.append(int(members[-1]))
        size.append(int(weight[members].sum()))
    return Partition(label, np.array(mean), np.array(low), np.array(high), np.array(size))


def _best_bounds(values: Array, weight: Array) -> list[int]:
    """Bounds of the clusters in the sorted values, for the smallest k that spreads little enough."""
    m = len(values)
    cost = _segment_costs(values, weight)
    total = weight.sum()
    best = [0, m]
    reach = cost[0].copy()  # least cost of the first j values in k clusters
    splits: list[IntArray] = []
    for k in range(1, min(m, MOST_CLUSTERS) + 1):
        if k > 1:
            candidate = reach[:, None] + cost
            split = np.argmin(candidate, axis=0)
            reach = candidate[split, np.arange(m + 1)]
            splits.append(split)
        bounds = [m]
        for split in reversed(splits):
            bounds.append(int(split[bounds[-1]]))
        bounds.append(0)
        bounds.reverse()
        if k > 1 and _too_close(values, weight, bounds):
            break
        best = bounds
        if reach[m] <= SPREAD_COUNTS**2 * total:
            break
    return best


def _segment_costs(values: Array, weight: Array) -> Array:
    """cost[i, j]: squared deviations of values i..j-1 from their mean; infinite unless i < j. (m+1, m+1)."""
    zero = np.zeros(1)
    w = np.concatenate([zero, np.cumsum(weight)])
    s = np.concatenate([zero, np.cumsum(weight * values)])
    q = np.concatenate([zero, np.cumsum(weight * values**2)])
    dw, ds, dq = w[None] - w[:, None], s[None] - s[:, None], q[None] - q[:, None]
    ordered = np.arange(len(w))[:, None] < np.arange(len(w))[None]
    spread = dq - ds**2 / np.where(ordered, dw, 1.0)
    return np.asarray(np.where(ordered, np.maximum(spread, 0.0), np.inf))


def _too_close(values: Array, weight: Array, bounds: list[int]) -> bool:
    """Whether two neighbouring clusters have means that the encoder cannot tell apart."""
    means = [np.average(values[a:b], weights=weight[a:b]) for a, b in pairwise(bounds)]
    return bool(np.any(np.diff(means) < APART_COUNTS))
