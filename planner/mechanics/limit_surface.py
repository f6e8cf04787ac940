"""The limit surface: maps wrenches to twists of a part that slides on the table (paper IV, eq. 1).

Wrenches and twists are normalised, so that all components have one unit and power is F . V:

    F = [fx, fy, tau / rho] / (mu N)        V = [vx, vy, omega rho]

about the origin of the part's frame, the centroid of the outline. mu N is the friction with the table at full
slip, and rho the radius of gyration of the outline's area, as in the success metric (eq. 9); any other rho
would describe the same mechanics. The ellipsoid is H(F) = F^T A F with H = 1 on the surface, V = s grad H(F),
s > 0.
"""

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import kernel

DIRECTIONS = 400  # Number of twists for which a fit integrates the friction

STILL = 1e-12
"""Speed, as a fraction of the twist, below which a support point is at rest and has no friction."""

MIN_EIGENVALUE = 1e-3
"""Least eigenvalue of a fitted A: semi-axes of about 30, longer than any pressure under the outline gives."""

DIGITS = 10
"""Decimals of an ellipsoid fitted to a pressure: further digits of LAPACK depend on the processor."""

_UPPER = np.triu_indices(3)


@dataclass(frozen=True, slots=True, eq=False)
class LimitSurface:
    """An ellipsoid limit surface."""

    A: Array  # (3, 3) symmetric positive definite, F^T A F = 1 on the surface; read-only
    rho_mm: float  # the length that torques are divided and angular velocities multiplied by


def fit_ellipsoid(points: Array, weights: Array, rho_mm: float) -> LimitSurface:
    """Fits an ellipsoid limit surface to a pressure distribution.

    See `about_centre` for the arguments.
    """
    F, V, shift = about_centre(points, weights, rho_mm)
    A = np.round(fit(F, V), DIGITS)
    A[:, :2] += A[:, 2:] * shift[2, :2]  # A S, then S^T A S
    A[:2] += shift[2, :2, None] * A[2]
    return LimitSurface(_frozen(A), rho_mm)


def about_centre(points: Array, weights: Array, rho_mm: float) -> tuple[Array, Array, Array]:
    """Samples pairs of wrench and twist about the centre of pressure.

    A surface that is fitted to these pairs does not depend on where the part's frame lies. Fitted about
    another point, a surface would let a force through the centre of pressure turn the part too much.

    Args:
        points: (M, 2) support points of the pressure, in the part's frame [mm].
        weights: (M,) shares of the support points, of sum 1.
        rho_mm: the length that normalises wrenches and twists.

    Returns:
        Wrenches (K, 3), twists (K, 3), and a matrix S (3, 3) that maps a wrench about the origin to the same
        wrench about the centre: a surface H(F) about the centre is H(S F) about the origin.
    """
    centre = np.array([math.fsum(weights * column) for column in points.T])
    twists = twist_directions()
    shift = np.eye(3)
    shift[2, :2] = centre[1] / rho_mm, -centre[0] / rho_mm
    return wrenches(points - centre, weights, rho_mm, twists), twists, shift


def wrenches(points: Array, weights: Array, rho_mm: float, twists: Array) -> Array:
    """Computes the wrench (K, 3) that makes a part slide with each twist, against Coulomb friction.

    The friction at a support point (M, 2) [mm] is the point's share (M,) of mu N, along its velocity (Goyal
    et al., the paper's reference [20]). A point at rest may carry any smaller friction; zero is used. Twists
    (K, 3) are normalised with rho, of any magnitude but 0.
    """
    x, y = points[:, 0] / rho_mm, points[:, 1] / rho_mm  # (M,)
    velocity_x = twists[:, 0:1] - twists[:, 2:3] * y  # (K, M)
    velocity_y = twists[:, 1:2] + twists[:, 2:3] * x
    speed = np.hypot(velocity_x, velocity_y)
    moving = speed > STILL * np.linalg.norm(twists, axis=1, keepdims=True)
    share = np.where(moving, weights / np.where(moving, speed, 1.0), 0.0)
    force_x, force_y = share * velocity_x, share * velocity_y
    return np.column_stack(
        [force_x.sum(axis=1), force_y.sum(axis=1), (force_y * x - force_x * y).sum(axis=1)]
    )


def twist_directions(count: int = DIRECTIONS) -> Array:
    """Unit twists (K, 3) spread evenly over the sphere, the same at every call.

    They are `count` / 4 Fibonacci points, each with both signs of its second component and both signs of its
    third one, so that a part that is its own mirror image gets a symmetric ellipsoid. The other sign of the
    first component would add nothing, since an opposite twist has the opposite wrench.
    """
    index = np.arange(max(count // 4, 1)) + 0.5
    z = 1.0 - 2.0 * index / len(index)
    azimuth = math.pi * (3.0 - math.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z * z)
    base = np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z])
    signs = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0], [1.0, -1.0, -1.0]])
    return np.concatenate([base * sign for sign in signs])


def fit(F: Array, V: Array, weights: Array | None = None) -> Array:
    """Fits the matrix A (3, 3) of an ellipsoid to wrenches and twists by least squares.

    The residuals of a pair are F^T A F - 1 (the wrench lies on the surface) and the component of A F across
    the unit twist (eq. 1), as Zhou et al. (the paper's [22]) fit a convex quadratic. In F and V (K, 3),
    torques and rotations are scaled by rho; twists may have any magnitude but 0. `weights` (K,) multiply the
    squared residuals.

    Returns:
        A, symmetric positive definite and read-only. Where noise would make A indefinite, eigenvalues are
        raised to `MIN_EIGENVALUE`.
    """
    unit = V / np.linalg.norm(V, axis=1, keepdims=True)
    basis = np.zeros((6, 3, 3))  # A = sum_b a_b basis_b
    basis[np.arange(6), _UPPER[0], _UPPER[1]] = 1.0
    basis[np.arange(6), _UPPER[1], _UPPER[0]] = 1.0
    gradient = np.einsum("bij,kj->kib", basis, F)  # A F, (K, 3, 6)
    level = np.einsum("ki,kib->kb", F, gradient)
    across = gradient - unit[:, :, None] * np.einsum("ki,kib->kb", unit, gradient)[:, None, :]
    rows = np.concatenate([level, across.reshape(-1, 6)])
    target = np.concatenate([np.ones(len(level)), np.zeros(across.shape[0] * 3)])
    if weights is not None:
        root = np.sqrt(np.concatenate([weights, np.repeat(weights, 3)]))
        rows, target = rows * root[:, None], target * root
    coefficients = np.linalg.lstsq(rows, target, rcond=None)[0]
    eigenvalues, vectors = np.linalg.eigh(np.einsum("b,bij->ij", coefficients, basis))
    raised = np.maximum(eigenvalues, MIN_EIGENVALUE)
    return _frozen((vectors * raised) @ vectors.T)


def wishart(mean: Array, dof: int | IntArray, rng: np.random.Generator, n: int) -> Array:
    """Draws n Wishart matrices (n, D, D) with a positive definite mean (D, D).

    The degrees of freedom `dof`, one number or (n,), are at least D. They determine the scatter:
    Var(X_ij) = (mean_ij^2 + mean_ii mean_jj) / dof (paper, footnote 1). The matrices are drawn by Bartlett's
    decomposition, without LAPACK and BLAS: one seed gives the same draws on every processor.
    """
    size = len(mean)
    drawn = np.empty((n, size, size))
    for row in range(size):
        drawn[:, row, row] = np.sqrt(rng.chisquare(dof - row, size=n) / dof)
        drawn[:, row, :row] = (
            rng.standard_normal((n, row)) / np.sqrt(np.broadcast_to(dof, n))[:, None]
        )
    _square(cholesky(mean), drawn)
    return drawn


def cholesky(A: Array) -> Array:
    """Lower triangular L with L L^T = A (D, D), positive definite: the same bits on every processor."""
    L = np.zeros(A.shape)
    for i in range(len(A)):
        for j in range(i + 1):
            rest = A[i, j] - math.fsum(L[i, :j] * L[j, :j])
            L[i, j] = math.sqrt(rest) if i == j else rest / L[j, j]
    return L


@kernel
def _square(factor: Array, drawn: Array) -> None:
    """Replaces each matrix B of `drawn` (n, D, D) by (L B) (L B)^T, with L = `factor`.

    L and all B are lower triangular.
    """
    n, size = drawn.shape[0], drawn.shape[1]
    product = np.empty((size, size))
    for k in range(n):
        for i in range(size):
            for j in range(i + 1):
                product[i, j] = 0.0
                for m in range(j, i + 1):
                    product[i, j] += factor[i, m] * drawn[k, m, j]
        for i in range(size):
            for j in range(i + 1):
                total = 0.0
                for m in range(j + 1):
                    total += product[i, m] * product[j, m]
                drawn[k, i, j] = drawn[k, j, i] = total


def twist(A: Array, F: Array) -> Array:
    """The unit twists (..., 3) that the wrenches F (..., 3) cause: along grad H (eq. 1)."""
    gradient = np.asarray(F) @ A
    return np.asarray(gradient / np.linalg.norm(gradient, axis=-1, keepdims=True))


def _frozen(A: Array) -> Array:
    """The symmetric part of a matrix, read-only."""
    symmetric = 0.5 * (A + A.T)
    symmetric.setflags(write=False)
    return symmetric
