"""Projection of particles onto the subspace of their width (paper V.C).

The learned motion model is not exact: its particles lie beside the poses in which two fingers can hold a
part. So each subspace is stored as the final poses of the roll-outs that end in it, and a particle moves to
the nearest stored pose of its subspace. Free space has all three dimensions, so particles in free space stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from planner.arrays import Array, IntArray
from planner.frames import wrap
from planner.learned.neighbours import wrap_up

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

STILL_MM = 1e-6  # Distance below which a particle is already at a stored pose


@dataclass(frozen=True, slots=True, eq=False)
class Projection:
    """Moves particles to the subspaces of one part, which are stored as final poses in the hand frame."""

    stored: dict[int, tuple[Array, cKDTree]]  # poses (n_k, 3) of each subspace, and their k-d tree
    rho_mm: float  # millimetres that count like one radian
    order: int  # rotational order of the part

    @classmethod
    def fit(cls, final: Array, label: IntArray, rho_mm: float, order: int) -> Self:
        """Stores final poses (n, 3) in the hand frame by the numbers `label` (n,) of their subspaces.

        `Subspaces.label` gives the numbers; poses in free space, number 0, are not stored.

        Raises:
            ValueError: a subspace has no pose, though a subspace with a higher number has poses.
        """
        from scipy.spatial import cKDTree  # importing scipy takes a tenth of a command's start-up

        stored = {}
        for k in range(1, int(label.max(initial=0)) + 1):
            poses = np.ascontiguousarray(final[label == k])
            if not len(poses):
                problem = f"subspace {k} has no final pose"
                raise ValueError(f"{problem}; number the subspaces without gaps")
            box = [0.0, 0.0, rho_mm * math.tau / order]
            stored[k] = poses, cKDTree(_points(poses, rho_mm, order), boxsize=box)
        return cls(stored, rho_mm, order)

    def project(self, poses: Array, label: IntArray) -> Array:
        """Moves particles (n, 3) to the nearest stored poses of their subspaces (BeliefUpdateProjection).

        `label` (n,) is the number of each particle's subspace. A particle whose subspace has no stored poses,
        such as free space, stays where it is. Of the angles equal by symmetry, the one nearest to the
        particle's angle is used. A second projection changes nothing.

        Returns:
            (n, 3) new poses.
        """
        result = np.array(poses, dtype=np.float64)
        for k, (stored, tree) in self.stored.items():
            members = np.flatnonzero(label == k)
            start = result[members]
            distance, nearest = tree.query(_points(start, self.rho_mm, self.order))
            end = stored[nearest]
            end[:, 2] = start[:, 2] + wrap(end[:, 2] - start[:, 2], self.order)
            result[members] = np.where(distance[:, None] > STILL_MM, end, start)
        return result


def _points(poses: Array, rho_mm: float, order: int) -> Array:
    """Normalises poses (n, 3) to x, y and rho theta [mm]; the angle is reduced to one period."""
    return np.column_stack([poses[:, :2], wrap_up(rho_mm * poses[:, 2], rho_mm * math.tau / order)])
