"""Limit surfaces for tests: a random one, the error of predicted twists, and the Hessian of a quartic."""

import numpy as np

from planner.part.quartic_form import PAIRS


def random_ellipsoid(rng):
    """Draws the matrix (3, 3) of an ellipsoidal limit surface; it is positive definite."""
    root = rng.normal(size=(3, 3))
    return root @ root.T + 0.2 * np.eye(3)


def mean_twist_error(predicted, twists):
    """Returns the mean angle between predicted unit twists (K, 3) and twists (K, 3) of any length [rad]."""
    cosine = (predicted * twists).sum(axis=1) / np.linalg.norm(twists, axis=1)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).mean())


def hessian(surface, F):
    """Returns the Hessian (..., 3, 3) of a quartic limit surface at wrenches F (..., 3)."""
    products = F[..., PAIRS[:, 0]] * F[..., PAIRS[:, 1]]
    entries = products @ surface.hessian_table().T
    result = np.empty((*entries.shape[:-1], 3, 3))
    result[..., PAIRS[:, 0], PAIRS[:, 1]] = result[..., PAIRS[:, 1], PAIRS[:, 0]] = entries
    return result
