"""One quasi-static step: the part's displacement while the fingers advance (paper, eqs 1-5).

The step is posed at displacement level. With the ellipsoid limit surface, eq. 1 reads V = A F up to a positive
factor that the forces absorb, so for contacts with wrench directions N_i (normal) and T_i (tangent)

    V = A sum_i (f_n N_i + f_t T_i)                                                     (1, 2)
    0 <= f_n  _|_  gap_i + N_i . V - u_n        >= 0                                     (3)
    0 <= f_t+ _|_  (T_i . V - u_t) + lambda_i   >= 0                                     (4)
    0 <= f_t- _|_ -(T_i . V - u_t) + lambda_i   >= 0                                     (4)
    0 <= lambda_i _|_ mu f_n - f_t+ - f_t-      >= 0                                     (5)

where V is a displacement and u the finger's; the gap in eq. 3 lets contacts close within the step and
removes drift. Twists and wrenches are normalised: V = (dx, dy, rho dtheta), F = (f_x, f_y, tau / rho).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planner.arrays import Array, IntArray
from planner.mechanics.contacts import CORNER, FACE, MAX_CONTACTS, Contacts
from planner.mechanics.lcp import PIVOT_LIMIT, RAY, SOLVED, lemke, residual

GAP_TOLERANCE_MM = 1e-7
"""Overlap that a contact outside the active set may have after a step."""


class StepWork(NamedTuple):
    """Workspace of `solve`.

    Attributes:
        N, T: (MAX_CONTACTS, 3) normal and tangent wrench directions, normalised.
        u: (MAX_CONTACTS, 2) the finger's displacement along normal and tangent [mm].
        M, q, tableau, basis, z: the LCP.
        active: (MAX_CONTACTS,) the contacts in the LCP.
        force: (MAX_CONTACTS, 2) f_n and f_t of the last solution, in units of A's inverse.
    """

    N: Array
    T: Array
    u: Array
    M: Array
    q: Array
    tableau: Array
    basis: IntArray
    z: Array
    active: IntArray
    force: Array


def workspace() -> StepWork:
    """A fresh workspace."""
    k, n = MAX_CONTACTS, 4 * MAX_CONTACTS
    return StepWork(
        N=np.zeros((k, 3)), T=np.zeros((k, 3)), u=np.zeros((k, 2)),
        M=np.zeros((n, n)), q=np.zeros(n), tableau=np.zeros((n, 2 * n + 2)),
        basis=np.zeros(n, np.int64), z=np.zeros(n),
        active=np.zeros(k, np.int64), force=np.zeros((k, 2)),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def rotate_surface(A: Array, theta: float, out: Array) -> None:
    """A in the hand frame for a part turned by theta; `out` (3, 3) is modified in place."""
    c, s = np.cos(theta), np.sin(theta)
    a, b, d = A[0, 0], A[0, 1], A[1, 1]
    out[0, 0] = c * c * a - 2.0 * c * s * b + s * s * d
    out[1, 1] = s * s * a + 2.0 * c * s * b + c * c * d
    out[0, 1] = c * s * (a - d) + (c * c - s * s) * b
    out[1, 0] = out[0, 1]
    out[0, 2] = c * A[0, 2] - s * A[1, 2]
    out[1, 2] = s * A[0, 2] + c * A[1, 2]
    out[2, 0], out[2, 1], out[2, 2] = out[0, 2], out[1, 2], A[2, 2]


@njit(cache=True, nogil=True)
def directions(
    contacts: Contacts, count: int, rho: float, top_advance: float, bottom_advance: float, work: StepWork
) -> None:
    """Wrench directions and finger displacements of all contacts, into `work` (the Jacobian of eq. 2)."""
    for k in range(count):
        nx, ny = contacts.n[k, 0], contacts.n[k, 1]
        rx, ry = contacts.r[k, 0], contacts.r[k, 1]
        work.N[k, 0], work.N[k, 1], work.N[k, 2] = nx, ny, (rx * ny - ry * nx) / rho
        work.T[k, 0], work.T[k, 1], work.T[k, 2] = -ny, nx, (rx * nx + ry * ny) / rho
        advance = -top_advance if contacts.finger[k] == 1 else bottom_advance
        work.u[k, 0], work.u[k, 1] = advance * ny, advance * nx


@njit(cache=True, nogil=True)
def _apply(A: Array, f: Array, out: Array) -> None:
    for i in range(3):
        out[i] = A[i, 0] * f[0] + A[i, 1] * f[1] + A[i, 2] * f[2]


@njit(cache=True, nogil=True)
def _form(A: Array, f: Array, g: Array) -> float:
    """f . A g."""
    return float(
        f[0] * (A[0, 0] * g[0] + A[0, 1] * g[1] + A[0, 2] * g[2])
        + f[1] * (A[1, 0] * g[0] + A[1, 1] * g[1] + A[1, 2] * g[2])
        + f[2] * (A[2, 0] * g[0] + A[2, 1] * g[1] + A[2, 2] * g[2])
    )


@njit(cache=True, nogil=True)
def _motion(A: Array, work: StepWork, m: int, V: Array) -> None:
    """V = A F (eq. 1) for the forces of the m active contacts; `V` is modified in place."""
    F0, F1, F2 = 0.0, 0.0, 0.0
    for a in range(m):
        k = work.active[a]
        fn, ft = work.force[k, 0], work.force[k, 1]
        F0 += fn * work.N[k, 0] + ft * work.T[k, 0]
        F1 += fn * work.N[k, 1] + ft * work.T[k, 1]
        F2 += fn * work.N[k, 2] + ft * work.T[k, 2]
    for i in range(3):
        V[i] = A[i, 0] * F0 + A[i, 1] * F1 + A[i, 2] * F2


@njit(cache=True, nogil=True)
def _one_contact(A: Array, mu: float, gap: float, work: StepWork) -> int:
    """Closed form for one contact: stick, else slide along the edge of the friction cone."""
    k = work.active[0]
    N, T = work.N[k], work.T[k]
    a, b, c = _form(A, N, N), _form(A, N, T), _form(A, T, T)
    un, ut = work.u[k, 0] - gap, work.u[k, 1]
    determinant = a * c - b * b
    fn, ft = (c * un - b * ut) / determinant, (a * ut - b * un) / determinant
    if abs(ft) <= mu * fn:
        work.force[k, 0], work.force[k, 1] = fn, ft
        return SOLVED
    for sign in (1.0 if ft > 0.0 else -1.0, -1.0 if ft > 0.0 else 1.0):
        fn = un / (a + sign * mu * b)
        slip = fn * (b + sign * mu * c) - ut
        if fn >= 0.0 and sign * slip <= 1e-12:
            work.force[k, 0], work.force[k, 1] = fn, sign * mu * fn
            return SOLVED
    return RAY


@njit(cache=True, nogil=True)
def _assemble(A: Array, mu: Array, contacts: Contacts, work: StepWork, m: int) -> None:
    """The LCP of the m active contacts; unknowns f_n (m), f_t+ (m), f_t- (m), lambda (m)."""
    M, q = work.M, work.q
    for a in range(m):
        k = work.active[a]
        for b in range(m):
            j = work.active[b]
            nn, nt = _form(A, work.N[k], work.N[j]), _form(A, work.N[k], work.T[j])
            tn, tt = _form(A, work.T[k], work.N[j]), _form(A, work.T[k], work.T[j])
            M[a, b], M[a, m + b], M[a, 2 * m + b], M[a, 3 * m + b] = nn, nt, -nt, 0.0
            M[m + a, b], M[m + a, m + b], M[m + a, 2 * m + b], M[m + a, 3 * m + b] = tn, tt, -tt, 0.0
            for c in range(3):
                M[2 * m + a, c * m + b] = -M[m + a, c * m + b]
            M[2 * m + a, 3 * m + b] = 0.0
            for c in range(4):
                M[3 * m + a, c * m + b] = 0.0
        M[m + a, 3 * m + a] = M[2 * m + a, 3 * m + a] = 1.0
        M[3 * m + a, a] = mu[0] if contacts.finger[k] == 1 else mu[1]
        M[3 * m + a, m + a] = M[3 * m + a, 2 * m + a] = -1.0
        q[a] = contacts.gap[k] - work.u[k, 0]
        q[m + a], q[2 * m + a], q[3 * m + a] = -work.u[k, 1], work.u[k, 1], 0.0


@njit(cache=True, nogil=True)
def _many_contacts(A: Array, mu: Array, contacts: Contacts, work: StepWork, m: int) -> int:
    """Lemke's method on the m active contacts, with the residual checked."""
    _assemble(A, mu, contacts, work, m)
    status = lemke(work.M, work.q, 4 * m, work.tableau, work.basis, work.z)
    if status != SOLVED:
        return status
    if residual(work.M, work.q, work.z, 4 * m) > 1e-7:
        return PIVOT_LIMIT
    for a in range(m):
        k = work.active[a]
        work.force[k, 0], work.force[k, 1] = work.z[a], work.z[m + a] - work.z[2 * m + a]
    return SOLVED


@njit(cache=True, nogil=True)
def solve(A: Array, mu: Array, contacts: Contacts, count: int, work: StepWork, V: Array) -> int:
    """Solves the step for the contacts whose directions are in `work`.

    Contacts enter the LCP one by one, the most violated first, until none of the others overlaps: most steps
    need one or two.

    Args:
        A: (3, 3) the limit surface's matrix in the hand frame.
        mu: (2,) friction at the upper and the lower finger.
        contacts: the contacts, with gaps [mm].
        count: how many of them are valid.
        work: workspace, its N, T and u filled by `directions`; modified in place.
        V: (3,) receives the displacement (dx, dy, rho dtheta) [mm].

    Returns:
        `SOLVED`, `RAY` (no solution: jammed or grasped) or `PIVOT_LIMIT`.
    """
    V[0] = V[1] = V[2] = 0.0
    m = 0
    status = SOLVED
    for _ in range(count + 1):
        worst, entering = -GAP_TOLERANCE_MM, -1
        for k in range(count):
            if m > 0 and _is_active(work, m, k):
                continue
            slack = contacts.gap[k] - work.u[k, 0]
            slack += work.N[k, 0] * V[0] + work.N[k, 1] * V[1] + work.N[k, 2] * V[2]
            if slack < worst:
                worst, entering = slack, k
        if entering < 0:
            return SOLVED
        work.active[m] = entering
        m += 1
        if m == 1:
            friction = mu[0] if contacts.finger[entering] == 1 else mu[1]
            status = _one_contact(A, friction, contacts.gap[entering], work)
        else:
            status = _many_contacts(A, mu, contacts, work, m)
        if status != SOLVED:
            break
        _motion(A, work, m, V)
    if status == SOLVED or m == count:
        return status
    # Not even the first contacts can be satisfied; all of them together decide.
    for k in range(count):
        work.active[k] = k
    status = _many_contacts(A, mu, contacts, work, count)
    if status == SOLVED:
        _motion(A, work, count, V)
    return status


@njit(cache=True, nogil=True)
def _is_active(work: StepWork, m: int, k: int) -> bool:
    for a in range(m):
        if work.active[a] == k:
            return True
    return False


@njit(cache=True, nogil=True)
def turn(contacts: Contacts, count: int, q: Array, half: Array, top: float, bottom: float, h: float) -> None:
    """Moves the contacts from pose q to the pose `half`, gaps unchanged: the midpoint rule's second look."""
    angle = half[2] - q[2]
    c, s = np.cos(angle), np.sin(angle)
    for k in range(count):
        rx, ry = contacts.r[k, 0], contacts.r[k, 1]
        if contacts.kind[k] == CORNER:
            nx, ny = contacts.n[k, 0], contacts.n[k, 1]
            nx, ny = c * nx - s * ny, s * nx + c * ny
            face = top if contacts.finger[k] == 1 else bottom
            contacts.n[k, 0], contacts.n[k, 1] = nx, ny
            contacts.r[k, 0] = contacts.side[k] * h + contacts.gap[k] * nx - half[0]
            contacts.r[k, 1] = face + contacts.gap[k] * ny - half[1]
        else:
            contacts.r[k, 0], contacts.r[k, 1] = c * rx - s * ry, s * rx + c * ry


__all__ = ["FACE", "PIVOT_LIMIT", "RAY", "SOLVED", "StepWork", "directions", "rotate_surface", "solve", "turn"]
