"""Convex quartic limit surfaces: H(F) homogeneous of degree 4, V = s grad H(F) (paper IV, eq. 1).

H(F) = sum_k a_k F^e_k over the 15 monomials of degree 4, with H = 1 on the surface; F and V are normalised as
in `limit_surface`. H is convex by a sum-of-squares certificate (Zhou et al., arXiv 1602.06056): a positive
definite 9 x 9 matrix Q with

    z^T hess H(F) z = y^T Q y    for all z and F,    y = kron(z, F).

For quartic forms in three variables this is no restriction: every convex one has such a Q (Ahmadi and
Parrilo, "A complete characterization of the gap between convexity and SOS-convexity", 2013). Q is not unique:
9 dimensions of it do not show in H. The surfaces made here carry the Q of largest determinant.

Euler's theorem for a form of degree 4 gives F . grad H = 4 H and hess H(F) F = 3 grad H(F). So

    V = s A(F) F    with    A(F) = hess H(F) / 3,

an ellipsoid's law whose matrix depends on the wrench: a quasi-static step with a quartic is a sequence of
ellipsoid steps, each with A taken at the wrench before.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.mechanics import limit_surface

EXPONENTS = np.array([(i, j, 4 - i - j) for i in range(4, -1, -1) for j in range(4 - i, -1, -1)])
"""(15, 3) powers of fx, fy and tau / rho in each monomial, in the order of the coefficients."""

CONSISTENT = 1e-9
"""How far, relative to the largest entry, a certificate may be from the Hessian that it certifies."""

_PAIRS = np.array([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)])
_MONOMIAL = {tuple(powers): k for k, powers in enumerate(EXPONENTS.tolist())}


def _tensor_index() -> Array:
    """Return (15, 9, 9): which coefficient each entry of the symmetric 4-tensor T_aibj belongs to, 0 or 1."""
    index = np.zeros((15, 3, 3, 3, 3))
    for axes in itertools.product(range(3), repeat=4):
        count = Counter(axes)
        index[_MONOMIAL[count[0], count[1], count[2]]][axes] = 1.0
    return index.reshape(15, 9, 9)


_ENTRIES = _tensor_index()
_MULTIPLICITY = _ENTRIES.sum(axis=(1, 2))  # 1, 4, 6 or 12 entries of T per monomial


def _form_index() -> Array:
    """Return (36, 81): the biquadratic form y^T Q y as coefficients of z_a z_b F_i F_j, a <= b and i <= j."""
    place = {pair: k for k, pair in enumerate(map(tuple, _PAIRS.tolist()))}
    index = np.zeros((6, 6, 3, 3, 3, 3))
    for a, i, b, j in itertools.product(range(3), repeat=4):
        index[place[min(a, b), max(a, b)], place[min(i, j), max(i, j)], a, i, b, j] = 1.0
    return index.reshape(36, 81)


def _null_space(rows: Array) -> Array:
    """Return an orthonormal basis (K, 9, 9) of the symmetric matrices Q with rows @ vec(Q) = 0."""
    swap = np.eye(81).reshape(9, 9, 81).transpose(1, 0, 2).reshape(81, 81)
    _, values, vectors = np.linalg.svd(np.concatenate([rows, np.eye(81) - swap]))
    return np.asarray(vectors[np.sum(values > 1e-9) :].reshape(-1, 9, 9))


def gram(coefficients: Array) -> Array:
    """Return 12 T, (..., 9, 9): one of the Q with y^T Q y = z^T hess H z; symmetric, not always definite."""
    return np.asarray(np.tensordot(12.0 * np.asarray(coefficients) / _MULTIPLICITY, _ENTRIES, axes=1))


def coefficients_of(certificate: Array) -> Array:
    """Return the coefficients (..., 15) of H = F^T hess H(F) F / 12 = y^T Q y / 12 at z = F.

    Linear in Q: the entries of Q that share a monomial are averaged.
    """
    return np.asarray(np.tensordot(certificate, _ENTRIES / 12.0, axes=([-2, -1], [1, 2])))


_FORM = _form_index()
COEFFICIENT_ROWS = _ENTRIES.reshape(15, 81) / 12.0
"""(15, 81): times vec(Q), the coefficients of the quartic that Q certifies."""

HESSIAN_ROWS = _FORM @ (np.eye(81) - 144.0 * COEFFICIENT_ROWS.T / _MULTIPLICITY @ COEFFICIENT_ROWS)
"""(36, 81), of rank 21: zero on vec(Q) exactly for the Q whose y^T Q y is the Hessian of some quartic."""

_GAUGE = _null_space(_FORM)  # (9, 9, 9) directions that y^T Q y does not see
_CERTIFICATES = _null_space(HESSIAN_ROWS)  # (24, 9, 9)


@dataclass(frozen=True, slots=True, eq=False)
class QuarticSurface:
    """A convex quartic limit surface.

    Attributes:
        coefficients: (15,) of the monomials `EXPONENTS`; read-only.
        certificate: (9, 9) symmetric positive definite Q of the convexity; read-only.
        rho_mm: the length that torques are divided and angular velocities multiplied by.
    """

    coefficients: Array
    certificate: Array
    rho_mm: float

    def value(self, F: Array) -> Array:
        """Return H at wrenches F (..., 3)."""
        return np.asarray(monomials(F) @ self.coefficients)

    def gradient(self, F: Array) -> Array:
        """Return grad H (..., 3) at wrenches F (..., 3)."""
        return np.asarray(gradient_rows(F) @ self.coefficients)

    def hessian(self, F: Array) -> Array:
        """Return hess H (..., 3, 3) at wrenches F (..., 3); 3 A(F) of the local ellipsoid's law."""
        entries = quadratics(F) @ self.hessian_table().T  # (..., 6)
        result = np.empty((*entries.shape[:-1], 3, 3))
        result[..., _PAIRS[:, 0], _PAIRS[:, 1]] = result[..., _PAIRS[:, 1], _PAIRS[:, 0]] = entries
        return result

    def hessian_table(self) -> Array:
        """Return (6, 6) for kernels: rows xx, xy, xz, yy, yz, zz of hess H, as sums of the six `quadratics`."""
        table = (_FORM @ gram(self.coefficients).reshape(81)).reshape(6, 6)
        return np.asarray(np.where(_PAIRS[:, :1] == _PAIRS[:, 1:], table, 0.5 * table))

    def twist(self, F: Array) -> Array:
        """Return the unit twists (..., 3) that answer the wrenches F (..., 3)."""
        gradient = self.gradient(F)
        return np.asarray(gradient / np.linalg.norm(gradient, axis=-1, keepdims=True))

    def mean_twist_error(self, F: Array, V: Array) -> float:
        """Return the mean angle, rad, between predicted and given twists (K, 3)."""
        cosine = (self.twist(F) * V).sum(axis=1) / np.linalg.norm(V, axis=1)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)).mean())

    def in_coordinates(self, S: Array) -> QuarticSurface:
        """Return the surface H'(F) = H(S F), S (3, 3) regular; the certificate goes along by congruence."""
        both = np.kron(S, S)
        return from_certificate(both.T @ self.certificate @ both, self.rho_mm)


def monomials(F: Array) -> Array:
    """Return the 15 monomials (..., 15) of wrenches F (..., 3)."""
    return np.asarray((np.asarray(F)[..., None, :] ** EXPONENTS).prod(axis=-1))


def gradient_rows(F: Array) -> Array:
    """Return the gradients (..., 3, 15) of the 15 monomials at wrenches F (..., 3)."""
    lowered = np.maximum(EXPONENTS[None] - np.eye(3, dtype=np.int64)[:, None], 0)  # (3, 15, 3)
    return np.asarray(EXPONENTS.T * (np.asarray(F)[..., None, None, :] ** lowered).prod(axis=-1))


def quadratics(F: Array) -> Array:
    """Return the products xx, xy, xz, yy, yz, zz (..., 6) of wrenches F (..., 3)."""
    F = np.asarray(F)
    return np.asarray(F[..., _PAIRS[:, 0]] * F[..., _PAIRS[:, 1]])


def of_ellipsoid(A: Array, rho_mm: float) -> QuarticSurface:
    """Return the ellipsoid F^T A F = 1 as a quartic: H = (F^T A F)^2, with Q = 8 vec(A) vec(A)^T + 4 A x A."""
    return from_certificate(8.0 * np.outer(A, A) + 4.0 * np.kron(A, A), rho_mm)


def from_certificate(Q: Array, rho_mm: float) -> QuarticSurface:
    """Return the surface that a certificate belongs to, with the certificate centred.

    Args:
        Q: (9, 9) positive definite; what is not part of any quartic's Hessian is projected away.
        rho_mm: normalising length.

    Raises:
        ValueError: Q is not positive definite, so that it certifies nothing.
    """
    Q = np.einsum("kij,k->ij", _CERTIFICATES, np.einsum("kij,ij->k", _CERTIFICATES, Q))
    if np.linalg.eigvalsh(Q)[0] <= 0.0:
        raise ValueError("the certificate is not positive definite; the quartic is not shown to be convex")
    certificate = _centred(Q)
    coefficients = coefficients_of(certificate)
    certificate.setflags(write=False)
    coefficients.setflags(write=False)
    return QuarticSurface(coefficients, certificate, rho_mm)


def certifies(certificate: Array, coefficients: Array) -> bool:
    """Say whether Q (9, 9) is positive definite and y^T Q y the Hessian of the quartic with these coefficients."""
    Q = np.asarray(certificate)
    gap = np.abs(_FORM @ (Q - gram(coefficients)).reshape(81)).max()
    scale = np.abs(Q).max()
    return bool((Q == Q.T).all() and gap <= CONSISTENT * scale and np.linalg.eigvalsh(Q)[0] > 0.0)


class Draws(NamedTuple):
    """Random quartics.

    Attributes:
        coefficients: (n, 15).
        certificates: (n, 9, 9), positive definite: each draw is convex.
        drawn_in: number of draws that had to be moved towards the nominal quartic to be certified.
    """

    coefficients: Array
    certificates: Array
    drawn_in: int


def sample(surface: QuarticSurface, dof: int, rng: np.random.Generator, n: int) -> Draws:
    """Draw random convex quartics around a nominal one, by Wishart draws of its certificate.

    A Wishart draw with mean Q is positive definite, but y^T Q' y is not the Hessian of any H: 21 of the 45
    dimensions of Q' belong to no quartic. They are projected away, orthogonally in the metric of Q (that is,
    with Q = C C^T, on C^-1 Q' C^-T); averaging plain entries instead would lose convexity. The mean stays Q,
    and the result does not depend on the units of F. The rare draw that the projection leaves indefinite is
    moved towards Q until it is not.

    Args:
        surface: the nominal quartic.
        dof: degrees of freedom n_df, at least 9.
        rng: source of randomness.
        n: number of draws.
    """
    factor = np.linalg.cholesky(surface.certificate)
    inverse = np.linalg.inv(factor)
    basis = np.linalg.qr((inverse @ _CERTIFICATES @ inverse.T).reshape(-1, 81).T)[0]  # (81, 24)
    white = limit_surface.wishart(np.eye(9), dof, rng, n).reshape(n, 81)
    white = (white @ basis @ basis.T).reshape(n, 9, 9)
    white = 0.5 * (white + white.transpose(0, 2, 1))
    least = np.linalg.eigvalsh(white)[:, 0] if n else np.zeros(0)
    kept = np.where(least > limit_surface.MIN_EIGENVALUE, 1.0, (1.0 - limit_surface.MIN_EIGENVALUE) / (1.0 - least))
    white = np.eye(9) + kept[:, None, None] * (white - np.eye(9))
    certificates = factor @ white @ factor.T
    return Draws(coefficients_of(certificates), certificates, int((kept < 1.0).sum()))


def _centred(Q: Array) -> Array:
    """Return the certificate of the same quartic with the largest determinant, by Newton steps on -log det."""
    for _ in range(100):
        factor = np.linalg.inv(np.linalg.cholesky(Q))
        white = factor @ _GAUGE @ factor.T  # (9, 9, 9)
        slope = np.trace(white, axis1=1, axis2=2)
        curvature = np.einsum("kij,lij->kl", white, white)
        step = np.linalg.solve(curvature, slope)
        decrement = float(np.sqrt(slope @ step))
        Q = Q + np.einsum("k,kij->ij", step / (1.0 + decrement), _GAUGE)
        if decrement < 1e-9:
            break
    return np.asarray(0.5 * (Q + Q.T))
