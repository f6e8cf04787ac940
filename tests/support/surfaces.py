"""Limit surfaces and their measures for tests."""

import numpy as np

from planner.part.quartic_form import PAIRS


def random_ellipsoid(rng):
    """A random positive definite matrix (3, 3)."""
    root = rng.normal(size=(3, 3))
    return root @ root.T + 0.2 * np.eye(3)


def mean_twist_error(predicted, twists):
    """Mean angle between predicted unit twists (K, 3) and others of any length [rad]."""
    cosine = (predicted * twists).sum(axis=1) / np.linalg.norm(twists, axis=1)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)).mean())


def hessian(surface, F):
    """hess H (..., 3, 3) of a quartic at wrenches F (..., 3)."""
    products = F[..., PAIRS[:, 0]] * F[..., PAIRS[:, 1]]
    entries = products @ surface.hessian_table().T
    result = np.empty((*entries.shape[:-1], 3, 3))
    result[..., PAIRS[:, 0], PAIRS[:, 1]] = result[..., PAIRS[:, 1], PAIRS[:, 0]] = entries
    return result
