"""Quartic forms in three variables and the matrices that certify their convexity, as plain linear algebra.

    H(F) = sum_k a_k F^e_k                        the 15 monomials of degree 4, `EXPONENTS`
    z^T hess H(F) z = y^T Q y, y = kron(z, F)     Q certifies H if positive definite

The symmetric matrices Q (9, 9) have 45 dimensions. The matrices of all quartics fill a subspace of 24
dimensions, and 9 of these do not affect y^T Q y.
"""

import itertools
from collections import Counter
from functools import cache

import numpy as np

from planner.arrays import Array

EXPONENTS = np.array([(i, j, 4 - i - j) for i in range(4, -1, -1) for j in range(4 - i, -1, -1)])
"""(15, 3) powers of fx, fy and tau / rho in each monomial, in the order of the coefficients."""

CONSISTENT = 1e-9
"""Tolerated distance of a certificate from the Hessian that it certifies, relative to the largest entry."""

PAIRS = np.array([(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)])
_MONOMIAL = {tuple(powers): k for k, powers in enumerate(EXPONENTS.tolist())}


def _tensor_index() -> Array:
    """Returns 15 masks (9, 9), one for each monomial of H: they mark the entries of T for this monomial.

    T is the symmetric 4-tensor of H, written as a matrix: T_aibj is in row 3 a + i and column 3 b + j. This
    entry is 1 in the mask of the monomial F_a F_i F_b F_j, and 0 in all other masks.
    """
    index = np.zeros((15, 3, 3, 3, 3))
    for axes in itertools.product(range(3), repeat=4):
        count = Counter(axes)
        index[_MONOMIAL[count[0], count[1], count[2]]][axes] = 1.0
    return index.reshape(15, 9, 9)


_ENTRIES = _tensor_index()
_MULTIPLICITY = _ENTRIES.sum(axis=(1, 2))  # 1, 4, 6 or 12 entries of T per monomial


def _form_index() -> Array:
    place = {pair: k for k, pair in enumerate(map(tuple, PAIRS.tolist()))}
    index = np.zeros((6, 6, 3, 3, 3, 3))
    for a, i, b, j in itertools.product(range(3), repeat=4):
        index[place[min(a, b), max(a, b)], place[min(i, j), max(i, j)], a, i, b, j] = 1.0
    return index.reshape(36, 81)


def _null_space(rows: Array) -> Array:
    """An orthonormal basis (K, 9, 9) of the symmetric matrices Q with rows @ vec(Q) = 0."""
    swap = np.eye(81).reshape(9, 9, 81).transpose(1, 0, 2).reshape(81, 81)
    _, values, vectors = np.linalg.svd(np.concatenate([rows, np.eye(81) - swap]))
    return np.asarray(vectors[np.sum(values > 1e-9) :].reshape(-1, 9, 9))


def gram(coefficients: Array) -> Array:
    """Returns for each quartic H (..., 15) a matrix Q (..., 9, 9) with y^T Q y = z^T hess H(w) z.

    This holds for all w and z; y holds their nine products z_i w_j. Q is 12 times the 4-tensor of H; it need
    not be positive definite.
    """
    shares = 12.0 * np.asarray(coefficients) / _MULTIPLICITY
    return np.asarray(np.tensordot(shares, _ENTRIES, axes=1))


def coefficients_of(certificate: Array) -> Array:
    """Returns the coefficients (..., 15) of the quartics H that matrices Q (..., 9, 9) certify.

    At z = F, H = F^T hess H(F) F / 12 = y^T Q y / 12, so the coefficients are linear in Q.
    """
    return np.asarray(np.tensordot(certificate, _ENTRIES / 12.0, axes=([-2, -1], [1, 2])))


FORM = _form_index()
"""(36, 81): maps vec(Q) to the coefficients of y^T Q y in z_a z_b F_i F_j, a <= b and i <= j."""

COEFFICIENT_ROWS = _ENTRIES.reshape(15, 81) / 12.0
"""(15, 81): maps vec(Q) to the coefficients of the quartic that Q certifies."""

HESSIAN_ROWS = FORM @ (np.eye(81) - 144.0 * COEFFICIENT_ROWS.T / _MULTIPLICITY @ COEFFICIENT_ROWS)
"""(36, 81), of rank 21: its null space is the Q whose y^T Q y is the Hessian of some quartic."""


@cache
def gauge() -> Array:
    """An orthonormal basis (9, 9, 9) of the changes of Q that leave y^T Q y the same."""
    return _null_space(FORM)


@cache
def certificates() -> Array:
    """An orthonormal basis (24, 9, 9) of the matrices Q whose y^T Q y is the Hessian form of some quartic."""
    return _null_space(HESSIAN_ROWS)


def monomials(F: Array) -> Array:
    """The 15 monomials (..., 15) of wrenches F (..., 3)."""
    return np.asarray((np.asarray(F)[..., None, :] ** EXPONENTS).prod(axis=-1))


def gradient_rows(F: Array) -> Array:
    """The gradients (..., 3, 15) of the 15 monomials at wrenches F (..., 3)."""
    lowered = np.maximum(EXPONENTS[None] - np.eye(3, dtype=np.int64)[:, None], 0)  # (3, 15, 3)
    return np.asarray(EXPONENTS.T * (np.asarray(F)[..., None, None, :] ** lowered).prod(axis=-1))


def certifies(certificate: Array, coefficients: Array) -> bool:
    """Whether Q (9, 9) is positive definite and y^T Q y is the Hessian of this quartic (15,)."""
    Q = np.asarray(certificate)
    gap = np.abs(FORM @ (Q - gram(coefficients)).reshape(81)).max()
    scale = np.abs(Q).max()
    return bool((Q == Q.T).all() and gap <= CONSISTENT * scale and np.linalg.eigvalsh(Q)[0] > 0.0)
