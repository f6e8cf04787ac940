"""Identifies a limit surface from motions alone: pushes with a round tip, without a force sensor.

The result is the ellipsoid, and the friction of the tip, with which simulated pushes end nearest to the
measured ones. The fit minimises the squared differences of x, y and rho times the angle, robustly against
outliers (soft L1, `SCALE_MM`), by scipy's trust-region method. The scale of the ellipsoid is arbitrary, since
it does not change where pushes end.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from planner.arrays import Array, take
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.push import Paths
from planner.mechanics.simulator import Simulator
from runtime.shell.errors import InputError

SCALE_MM = 2.0  # residual above which residuals count linearly, not squared
LEAST_PUSHES = 6
STILL_MM = 0.01  # motion up to which a part has not been pushed
FRICTION = (0.01, 1.5)  # bounds on the friction coefficient of the tip
STEP = 1e-2  # relative step of finite differences: a push is smooth except where contacts change


class Motions(NamedTuple):
    """Pushes by a round tip, and the resulting motions of the part."""

    paths: Paths  # paths of the tip, in the part's frame at the start; they begin clear of the part
    moved: Array  # (n, 3) measured displacement of the centroid [mm, mm, rad]


class Fitted(NamedTuple):
    """The limit surface of the part and the friction of the tip, fitted to pushes."""

    surface: LimitSurface
    friction: float  # friction coefficient between tip and part


def fit(motions: Motions, part: Simulator, radius_mm: float, friction: float = 0.3) -> Fitted:
    """Fits an ellipsoid and the friction of the tip to motions, starting from the unit sphere and `friction`.

    Args:
        motions: pushes and the motions measured.
        part: simulates the pushes, with limit surfaces of the same rho.
        radius_mm: radius of the tip.
        friction: initial guess of the friction coefficient of the tip.

    Raises:
        InputError: fewer than `LEAST_PUSHES` pushes move the part; each unknown needs one.
    """
    n, rho = len(motions.moved), part.surface.rho_mm
    moving = int((np.abs(motions.moved * [1.0, 1.0, rho]).max(axis=1) > STILL_MM).sum())
    if moving < LEAST_PUSHES:
        problem = f"{moving} of {n} pushes move the part"
        raise InputError(f"{problem}; give at least {LEAST_PUSHES} that do", key="pushes")

    def residuals(unknown: Array) -> Array:
        values = unknown - 1.0
        return _off(motions, part, _ellipsoid(values[:5]), float(values[5]), radius_mm).ravel()

    # All unknowns are shifted by 1, so that relative steps of derivatives have one size.
    start = 1.0 + np.append(np.zeros(5), friction)
    low = 1.0 + np.append(np.full(5, -3.0), FRICTION[0])
    high = 1.0 + np.append(np.full(5, 3.0), FRICTION[1])
    result = least_squares(
        residuals,
        start,
        bounds=(low, high),
        loss="soft_l1",
        f_scale=SCALE_MM,
        diff_step=STEP,
        max_nfev=40,
    )
    values = result.x - 1.0
    return Fitted(LimitSurface(_ellipsoid(values[:5]), rho), float(values[5]))


def errors_mm(fitted: Fitted, motions: Motions, part: Simulator, radius_mm: float) -> Array:
    """Errors (n,) of the predicted motions in the success metric: distance plus rho times the angle [mm]."""
    off = _off(motions, part, fitted.surface.A, fitted.friction, radius_mm)
    return np.asarray(np.hypot(off[:, 0], off[:, 1]) + np.abs(off[:, 2]))


def held_out_mm(
    motions: Motions, part: Simulator, radius_mm: float, splits: int, rng: np.random.Generator
) -> Array:
    """Returns the median error of predicted motions in each random split, (splits,) [mm].

    Each split fits to one half of the motions and predicts the other half.
    """
    n, errors = len(motions.moved), np.empty(splits)
    for split in range(splits):
        order = rng.permutation(n)
        known, unseen = take(motions, order[: n // 2]), take(motions, order[n // 2 :])
        errors[split] = np.median(errors_mm(fit(known, part, radius_mm), unseen, part, radius_mm))
    return errors


def _off(motions: Motions, part: Simulator, A: Array, friction: float, radius_mm: float) -> Array:
    """Simulated less measured displacements of the part (n, 3): x, y, rho times the angle [mm]."""
    n = len(motions.moved)
    parameters = part.nominal(n, friction)._replace(surfaces=np.repeat(A[None], n, axis=0))
    pushed = part.push(motions.paths, parameters, radius_mm)
    return np.asarray((pushed.moved - motions.moved) * [1.0, 1.0, part.surface.rho_mm])


def _ellipsoid(unknown: Array) -> Array:
    """Builds a positive definite matrix (3, 3) with first entry 1 from five unknowns (5,).

    The unknowns are entries of the matrix's Cholesky factor: the three below the diagonal, then the
    logarithms of the last two on the diagonal.
    """
    x, y, z, log_y, log_z = unknown
    L = np.array([[1.0, 0.0, 0.0], [x, np.exp(log_y), 0.0], [y, z, np.exp(log_z)]])
    return np.asarray(L @ L.T)
