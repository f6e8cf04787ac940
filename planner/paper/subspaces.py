"""Subspaces of final poses by width (paper V.A, Fig. 4), from all roll-outs of a part.

k-means clusters the widths, as in the paper. k is the smallest number of clusters that explains nearly all of
the variance of the held widths; for the paper's rectangle k is 4, as in the paper. Clusters that the encoder
cannot distinguish are merged. Free space, where the jaws close on nothing, is always the first cluster.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.observation import Encoder, resolution_of

EXPLAINED = 0.97  # Least share of the variance of held widths between subspaces
BIN_MM = 0.05  # Distance below which widths are the same: finer than the simulator's step resolves
ONE_WIDTH_MM = 0.1  # Root mean square spread at which a cluster is one width and is not cut
MOST_CLUSTERS = 10


@dataclass(frozen=True, slots=True, eq=False)
class Subspaces:
    """Clusters of widths in ascending order; the first is free space, even if no roll-out ended there."""

    mean_mm: Array  # (k,) mean width of each cluster
    size: IntArray  # (k,) number of roll-outs that ended in each cluster
    edges_mm: Array  # (k - 1,) widths that separate neighbouring clusters

    def __len__(self) -> int:
        return len(self.mean_mm)

    def label(self, width_mm: Array) -> IntArray:
        """The number (n,) of the subspace of each width (n,) [mm]; 0 is free space."""
        return np.asarray(np.searchsorted(self.edges_mm, width_mm, side="right"), dtype=np.int64)


def subspaces_of(width_mm: Array, encoder: Encoder) -> Subspaces:
    """Clusters the widths (n,) of all roll-outs of a part [mm].

    A roll-out in which the fingers closed on nothing has width 0. Clusters whose means the encoder cannot
    distinguish are merged.
    """
    resolution = resolution_of(encoder)
    free_mm = max(float(encoder.width_mm(np.asarray(resolution.free - 0.5))), BIN_MM)
    empty = width_mm < free_mm
    held = _clusters(np.sort(width_mm[~empty]), resolution.apart * encoder.mm_per_step)
    groups = [width_mm[empty], *held]
    between = [0.5 * (lower[-1] + upper[0]) for lower, upper in pairwise(held)]
    return Subspaces(
        mean_mm=np.array([group.mean() if len(group) else 0.0 for group in groups]),
        size=np.array([len(group) for group in groups]),
        edges_mm=np.array([free_mm, *between])[: len(held)],
    )


def _clusters(held: Array, apart_mm: float) -> list[Array]:
    """Splits rising widths (n,) of held parts into clusters whose means are at least `apart_mm` apart."""
    from sklearn.cluster import KMeans  # the import takes two seconds, and most plans learn nothing

    if not len(held):
        return []
    values, count = np.unique(np.round(held / BIN_MM), return_counts=True)
    spread = max((ONE_WIDTH_MM / BIN_MM) ** 2, (1.0 - EXPLAINED) * held.var() / BIN_MM**2)
    enough = len(held) * spread
    for k in range(1, min(MOST_CLUSTERS, len(values)) + 1):
        solved = KMeans(k, n_init=10, random_state=0).fit(values[:, None], sample_weight=count)
        if solved.inertia_ <= enough:
            break
    starts = np.cumsum(count)[np.flatnonzero(np.diff(solved.labels_))]
    groups = np.split(held, starts)
    while len(groups) > 1:
        distance = np.diff([group.mean() for group in groups])
        nearest = int(np.argmin(distance))
        if distance[nearest] >= apart_mm:
            break
        groups[nearest : nearest + 2] = [np.concatenate(groups[nearest : nearest + 2])]
    return groups
