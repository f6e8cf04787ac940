"""The energy distance of two samples of poses.

    E(A, B) = 2 mean|a - b| - mean|a - a'| - mean|b - b'|        (Szekely and Rizzo 2013)

with all pairs in the means, also of a pose with itself. It is zero for equal samples only, and needs no bins.
Poses are compared as points (x, y, r cos n theta, r sin n theta), r = rho / n: near one another that is the
paper's normalised pose (V.A), without a seam where the angle wraps under the rotational order n.
"""

import numpy as np

from planner.arrays import Array


def energy_distance(a: Array, b: Array, rho_mm: float, order: int = 1) -> float:
    """Energy distance of two samples of poses (n, 3) and (m, 3), n, m >= 1 [mm]; at least 0.

    `rho_mm` is what one radian weighs, `order` the part's rotational order.
    """
    from scipy.spatial.distance import cdist  # half as long to import as numba

    radius = rho_mm / order

    def points(poses: Array) -> Array:
        """(n, 4) whose Euclidean distances respect the part's symmetry [mm]."""
        turn = order * poses[:, 2]
        return np.column_stack(
            [poses[:, 0], poses[:, 1], radius * np.cos(turn), radius * np.sin(turn)]
        )

    first, second = points(a), points(b)
    within = float(cdist(first, first).mean() + cdist(second, second).mean())
    return max(2.0 * float(cdist(first, second).mean()) - within, 0.0)
