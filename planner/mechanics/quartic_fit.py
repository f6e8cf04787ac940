"""Fits a convex quartic limit surface to pairs of wrench and twist, as a conic program (arXiv 1602.06056).

The residuals of a pair are H(F) - 1 (the wrench lies on the surface) and the component of grad H(F) / 4
across the unit twist (eq. 1). They are linear in the coefficients of H, and the coefficients are linear in
the certificate Q. So the fit is a least squares problem over positive semidefinite Q that belong to a
quartic. It uses wrench coordinates in which the fitted ellipsoid is the unit sphere, so that all numbers are
of similar size. CVXPY takes a second to import, so it is imported where the program is built.
"""

import warnings
from functools import lru_cache
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array
from planner.mechanics import limit_surface, quartic
from planner.mechanics.quartic import QuarticSurface
from planner.part import quartic_form
from runtime.shell.errors import ExpectedError

MARGIN = 1e-3
"""Share of the sphere's certificate in every fitted one: it makes the surface strictly convex."""

REWEIGHTS = 2  # Rounds of a robust fit after the first

TYPICAL_ERROR_RAD = 0.1  # Twist errors above this count linearly, not squared, in a robust fit

_SPHERE = quartic.of_ellipsoid(np.eye(3), 1.0)
_DIRECTIONS = limit_surface.twist_directions(200)
_SPREAD = quartic_form.monomials(_DIRECTIONS) / np.sqrt(len(_DIRECTIONS))
"""(200, 15): the squared norm of _SPREAD a is the mean square of H over the unit sphere."""


class QuarticFitError(ExpectedError):
    """The conic solver found no certified quartic."""


def fit_pressure(points: Array, weights: Array, rho_mm: float) -> QuarticSurface:
    """Fits a convex quartic to a pressure distribution.

    See `limit_surface.about_centre` for the arguments.
    """
    F, V, shift = limit_surface.about_centre(points, weights, rho_mm)
    return fit(F, V, rho_mm).in_coordinates(shift)


def fit(
    F: Array,
    V: Array,
    rho_mm: float,
    weights: Array | None = None,
    ridge: float = 0.0,
    robust: bool = False,
) -> QuarticSurface:
    """Fits a convex quartic to pairs of normalised wrenches (K, 3) and twists (K, 3) of any magnitude but 0.

    Args:
        F: wrenches.
        V: their twists.
        rho_mm: the length that normalises both.
        weights: (K,) weights of the squared residuals of the pairs; None: all 1.
        ridge: weight that pulls the quartic towards the ellipsoid fitted to the same pairs; it counts like
            this number of pairs.
        robust: whether large angles between given and fitted twists count linearly, not squared, since
            measured pairs may have outliers.

    Raises:
        QuarticFitError: the solver finds no certified quartic.
    """
    weights = np.ones(len(F)) if weights is None else np.asarray(weights, dtype=np.float64)
    unit = V / np.linalg.norm(V, axis=1, keepdims=True)
    # |whiten F| = 1 on the ellipsoid
    whiten = np.asarray(np.linalg.cholesky(limit_surface.fit(F, V, weights)).T, dtype=np.float64)
    level = quartic_form.monomials(F @ whiten.T)
    gradient = whiten.T @ quartic_form.gradient_rows(F @ whiten.T) / 4.0  # (K, 3, 15)
    across = gradient - unit[:, :, None] * np.einsum("ki,kib->kb", unit, gradient)[:, None, :]
    pull = np.sqrt(ridge) * _SPREAD
    target = np.concatenate([np.sqrt(weights), np.zeros(3 * len(F)), pull @ _SPHERE.coefficients])
    weighed = weights
    for _ in range(REWEIGHTS + 1 if robust else 1):
        turned = (np.sqrt(weighed)[:, None, None] * across).reshape(-1, 15)
        rows = np.concatenate([np.sqrt(weights)[:, None] * level, turned, pull])
        surface = _solve(rows, target, rho_mm, len(F))
        weighed = weights * emphasis(gradient @ surface.coefficients, unit)
    return surface.in_coordinates(whiten)


def emphasis(gradient: Array, unit: Array) -> Array:
    """Weights (K,) of squared residuals that make a fit robust against measured twists of wrong direction.

    `gradient` (K, 3) are the twists that the fit predicts, of any length, and `unit` (K, 3) the measured
    twists, of length 1. A residual is the component of `gradient` across `unit`. Where the angle between the
    two twists is large, the weighted squared residual grows linearly with the angle, not quadratically.
    """
    size = np.linalg.norm(gradient, axis=1)
    angle = np.arccos(np.clip((gradient * unit).sum(axis=1) / size, -1.0, 1.0))
    return np.asarray(1.0 / (size**2 * np.hypot(angle, TYPICAL_ERROR_RAD)))


class _Program(NamedTuple):
    """The conic program: finds the certified coefficients a with the least |factor a - target|^2."""

    problem: Any
    factor: Any
    target: Any
    certificate: Any


@lru_cache(maxsize=1)
def _program() -> _Program:
    """Builds the conic program at the first call; each fit then sets its factor and target."""
    cvxpy: Any = import_module("cvxpy")
    factor, target = cvxpy.Parameter((15, 15)), cvxpy.Parameter(15)
    beyond = cvxpy.Variable((9, 9), PSD=True)
    certificate = beyond + MARGIN * _SPHERE.certificate
    flat = cvxpy.reshape(certificate, (81,), order="C")
    coefficients = cvxpy.Variable(15)
    constraints = [
        coefficients == quartic_form.COEFFICIENT_ROWS @ flat,
        _independent(quartic_form.HESSIAN_ROWS) @ flat == 0.0,
    ]
    problem = cvxpy.Problem(
        cvxpy.Minimize(cvxpy.sum_squares(factor @ coefficients - target)), constraints
    )
    return _Program(problem, factor, target, certificate)


def _independent(rows: Array) -> Array:
    """An orthonormal basis of the space of the rows, since solvers cope badly with redundant constraints."""
    _, values, vectors = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(vectors[values > 1e-9 * values[0]])


def _solve(rows: Array, target: Array, rho_mm: float, pairs: int) -> QuarticSurface:
    """Finds the certified quartic whose coefficients a have the least |rows a - target|^2.

    Raises:
        QuarticFitError: the solver finds none; the message states the number of `pairs`.
    """
    cvxpy: Any = import_module("cvxpy")
    program = _program()
    values, vectors = np.linalg.eigh(rows.T @ rows)
    root = np.sqrt(np.maximum(values, 1e-10 * values[-1]))
    program.factor.value = root[:, None] * vectors.T
    program.target.value = vectors.T @ (rows.T @ target) / root
    try:
        with warnings.catch_warnings():
            # An inaccurate solution is judged below, by its certificate.
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            program.problem.solve(solver=cvxpy.CLARABEL)
        if program.certificate.value is None:
            raise _failure(program.problem.status, pairs)
        return quartic.from_certificate(program.certificate.value, rho_mm)
    except (cvxpy.SolverError, ValueError) as error:
        raise _failure(error, pairs) from error


def _failure(reason: object, pairs: int) -> QuarticFitError:
    return QuarticFitError(
        f"the conic solver found no convex quartic for {pairs} pairs ({reason}); "
        "check the pairs for outliers, or fit an ellipsoid"
    )
