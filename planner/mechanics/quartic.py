"""Convex quartic limit surfaces: H(F) homogeneous of degree 4, V = s grad H(F) (paper IV, eq. 1).

H(F) = sum_k a_k F^e_k over the 15 monomials of degree 4, with H = 1 on the surface; F and V are normalised as
in `limit_surface`. A positive definite certificate Q (9, 9) shows that H is convex
(`planner.part.quartic_form`; Zhou et al., arXiv 1602.06056). Every convex quartic form in three variables has
such a Q (Ahmadi and Parrilo 2013). Q is not unique: the surfaces of this module have the Q of largest
determinant.

By Euler's theorem V = s A(F) F with A(F) = hess H(F) / 3: an ellipsoid's law whose matrix depends on the
wrench.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from planner.arrays import Array, IntArray
from planner.mechanics import limit_surface
from planner.part.quartic_form import (
    FORM,
    PAIRS,
    certificates,
    coefficients_of,
    gauge,
    gradient_rows,
    gram,
    monomials,
)

ROUNDING = 1e-12  # Keeps a draw with few degrees of freedom positive definite


@dataclass(frozen=True, slots=True, eq=False)
class QuarticSurface:
    """A convex quartic limit surface."""

    coefficients: Array  # (15,) coefficients of the monomials `EXPONENTS`; read-only
    certificate: Array  # (9, 9) symmetric positive definite Q that shows convexity; read-only
    rho_mm: float  # the length that torques are divided and angular velocities multiplied by

    def value(self, F: Array) -> Array:
        """H at wrenches F (..., 3)."""
        return np.asarray(monomials(F) @ self.coefficients)

    def gradient(self, F: Array) -> Array:
        """Grad H (..., 3) at wrenches F (..., 3)."""
        return np.asarray(gradient_rows(F) @ self.coefficients)

    def hessian_table(self) -> Array:
        """Table (6, 6) from which kernels compute the Hessian of H at a wrench F.

        The table times the six products of two components of F gives the entries xx, xy, xz, yy, yz, zz of
        the Hessian.
        """
        table = (FORM @ gram(self.coefficients).reshape(81)).reshape(6, 6)
        return np.asarray(np.where(PAIRS[:, :1] == PAIRS[:, 1:], table, 0.5 * table))

    def twist(self, F: Array) -> Array:
        """The unit twists (..., 3) that the wrenches F (..., 3) cause."""
        gradient = self.gradient(F)
        return np.asarray(gradient / np.linalg.norm(gradient, axis=-1, keepdims=True))

    def in_coordinates(self, S: Array) -> QuarticSurface:
        """Returns the surface H'(F) = H(S F), where H is this surface and S (3, 3) a regular matrix.

        The certificate of H' is the certificate of H, transformed by congruence.
        """
        both = np.kron(S, S)
        return from_certificate(both.T @ self.certificate @ both, self.rho_mm)


def of_ellipsoid(A: Array, rho_mm: float) -> QuarticSurface:
    """The ellipsoid as a quartic: H = (F^T A F)^2, with Q = 8 vec(A) vec(A)^T + 4 kron(A, A)."""
    return from_certificate(8.0 * np.outer(A, A) + 4.0 * np.kron(A, A), rho_mm)


def from_certificate(Q: Array, rho_mm: float) -> QuarticSurface:
    """Builds the quartic surface that a certificate Q (9, 9) proves convex.

    The component of Q that belongs to no quartic's Hessian is removed first.

    Raises:
        ValueError: the rest of Q is not positive definite, so that it certifies nothing.
    """
    basis = certificates()
    Q = np.einsum("kij,k->ij", basis, np.einsum("kij,ij->k", basis, Q))
    if np.linalg.eigvalsh(Q)[0] <= 0.0:
        raise ValueError(
            "the certificate is not positive definite; the quartic is not shown to be convex"
        )
    certificate = _centred(Q)
    coefficients = coefficients_of(certificate)
    certificate.setflags(write=False)
    coefficients.setflags(write=False)
    return QuarticSurface(coefficients, certificate, rho_mm)


def sample(surface: QuarticSurface, dof: int | IntArray, rng: np.random.Generator, n: int) -> Array:
    """Draws n random quartics about a nominal one; returns their tables (n, 6, 6), see `hessian_table`.

    Each is the nominal quartic in other coordinates. The change of coordinates takes the ellipsoid nearest to
    the quartic into a Wishart draw with this ellipsoid as mean and with `dof` degrees of freedom. So quartics
    scatter like ellipsoids (a squared ellipsoid in exactly the same way) and stay convex.
    """
    factor, white = _factor(surface), limit_surface.wishart(np.eye(3), dof, rng, n)
    root = np.linalg.cholesky(white + ROUNDING * np.eye(3))
    turned = factor @ root @ np.linalg.inv(factor)  # S^T
    return np.asarray(lifted(turned) @ surface.hessian_table() @ lifted(turned.transpose(0, 2, 1)))


@lru_cache(maxsize=256)
def _factor(surface: QuarticSurface) -> Array:
    """Lower triangular L (3, 3): L L^T is the ellipsoid nearest to a quartic."""
    F = limit_surface.twist_directions()
    F /= surface.value(F)[:, None] ** 0.25
    A = limit_surface.fit(F, surface.twist(F))
    return limit_surface.cholesky(np.round(A, limit_surface.DIGITS))


def lifted(S: Array) -> Array:
    """Matrices (n, 6, 6) that act on the products of two coordinates as S (n, 3, 3) acts on the coordinates.

    There are six such products (`PAIRS`).
    """
    (i, j), (k, m) = PAIRS.T[:, :, None], PAIRS.T[:, None, :]
    other = np.where(k == m, 0.0, 1.0)
    return np.asarray(S[:, i, k] * S[:, j, m] + other * S[:, i, m] * S[:, j, k])


def _centred(Q: Array) -> Array:
    """Returns the convexity certificate of largest determinant for the quartic that Q (9, 9) certifies.

    Newton's method minimises -log det over all certificates of the quartic, starting at Q.
    """
    for _ in range(100):
        factor = np.linalg.inv(np.linalg.cholesky(Q))
        white = factor @ gauge() @ factor.T  # (9, 9, 9)
        slope = np.trace(white, axis1=1, axis2=2)
        curvature = np.einsum("kij,lij->kl", white, white)
        step = np.linalg.solve(curvature, slope)
        decrement = float(np.sqrt(slope @ step))
        Q = Q + np.einsum("k,kij->ij", step / (1.0 + decrement), gauge())
        if decrement < 1e-9:
            break
    return np.asarray(0.5 * (Q + Q.T))
