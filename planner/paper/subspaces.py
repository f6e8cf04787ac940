"""Subspaces of final poses by width (paper V.A, Fig. 4), from all roll-outs of a part.

k-means on the widths, as in the paper. k is the smallest number of clusters that explains nearly all of the
variance of the held widths; for the paper's rectangle that is its k of 4. Clusters that the encoder cannot
tell apart are merged, and `Subspaces.notes` says so. Free space, where the jaws close on nothing, is always
the first.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.observation import HOLE, Encoder, cut, resolution_of

EXPLAINED = 0.97  # Least share of the variance of held widths between subspaces
BIN_MM = 0.05  # Distance below which widths are the same: finer than the simulator's step resolves
ONE_WIDTH_MM = 0.1  # Root mean square spread at which a cluster is one width and is not cut


@dataclass(frozen=True, slots=True, eq=False)
class Subspaces:
    """Clusters of widths in ascending order; the first is free space, even if no roll-out ended there."""

    low_mm: Array  # (k,) least width in each
    mean_mm: Array  # (k,) mean width
    high_mm: Array  # (k,) greatest width
    size: IntArray  # (k,) roll-outs that ended in it
    edges_mm: Array  # (k - 1,) widths between neighbours
    merged_mm: Array  # (m, 2) mean widths of the pairs of clusters that were merged, narrower first
    apart_mm: float  # least distance of mean widths that the encoder distinguishes
    overlooked: int  # held roll-outs with the reading of an empty hand; they count as free

    def __len__(self) -> int:
        return len(self.mean_mm)

    def label(self, width_mm: Array) -> IntArray:
        """Subspace of each width: (n,) to (n,); 0 is free space."""
        return np.asarray(np.searchsorted(self.edges_mm, width_mm, side="right"), dtype=np.int64)

    def figures(self) -> list[dict[str, float]]:
        """For JSON."""
        columns = zip(self.low_mm, self.mean_mm, self.high_mm, self.size, strict=True)
        return [
            {
                "low_mm": float(low),
                "mean_mm": float(mean),
                "high_mm": float(high),
                "rollouts": int(size),
            }
            for low, mean, high, size in columns
        ]

    def notes(self) -> list[str]:
        """Merged and overlooked clusters, one sentence each."""
        sentences = [
            f"widths about {a:.2f} and {b:.2f} mm are one subspace: they are {b - a:.2f} mm apart, and the "
            f"encoder tells {self.apart_mm:.2f} mm apart"
            for a, b in self.merged_mm
        ]
        if self.overlooked:
            sentences.append(
                f"{self.overlooked} roll-outs ended held at less than {self.edges_mm[0]:.2f} mm, which reads "
                "like an empty hand; they count as free space"
            )
        return sentences


def subspaces_of(width_mm: Array, encoder: Encoder) -> Subspaces:
    """Clusters the widths (n,) of all roll-outs of a part [mm]; 0 where the fingers closed on nothing."""
    resolution = resolution_of(encoder)
    apart_mm = resolution.apart * encoder.mm_per_step
    free_mm = max(float(encoder.width_mm(np.asarray(resolution.free - 0.5))), BIN_MM)
    empty = width_mm < free_mm
    held = width_mm[~empty]
    groups, merged = _held_groups(held, encoder.opening_mm, apart_mm, 1.0 - EXPLAINED)
    groups = [width_mm[empty], *groups]
    measures = [
        (part.min(), part.mean(), part.max()) if len(part) else (0.0, 0.0, 0.0) for part in groups
    ]
    low, mean, high = np.array(measures).T
    between = 0.5 * (high[1:-1] + low[2:])
    return Subspaces(
        low_mm=low,
        mean_mm=mean,
        high_mm=high,
        size=np.array([len(part) for part in groups]),
        edges_mm=np.concatenate([[free_mm], between])[: len(groups) - 1],
        merged_mm=merged,
        apart_mm=apart_mm,
        overlooked=int(np.count_nonzero(empty & (width_mm > 0.0))),
    )


def _held_groups(
    held: Array, opening_mm: float, apart_mm: float, within: float
) -> tuple[list[Array], Array]:
    """The widths (n,) of held parts by cluster, in ascending order, and the merged means (m, 2)."""
    if not len(held):
        return [], np.empty((0, 2))
    bins = int(opening_mm / BIN_MM) + 1
    place = np.clip(((opening_mm - held) / BIN_MM).astype(np.int64), 0, bins - 1)
    weight = np.bincount(place, minlength=bins)
    apart = apart_mm / BIN_MM
    bounds, merged = cut(weight, bins, ONE_WIDTH_MM / BIN_MM, within, apart, HOLE * apart)
    groups = [held[(place >= start) & (place < stop)] for stop, start in pairwise(bounds)]
    return groups, opening_mm - BIN_MM * (merged[:, ::-1] + 0.5)
