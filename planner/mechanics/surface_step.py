"""The step for either limit surface: one LCP for the ellipsoid, a sequence of them for the quartic.

A convex quartic obeys V = s A(F) F with A(F) = hess H(F) / 3 (Euler's theorem). The step is solved with A
at the previous wrench until the wrench's direction converges: a fixed point of eqs 1-5 (paper, IV.A:
"solving a sequence of LCP problems").
"""

import numpy as np

from planner.arrays import Array
from planner.kernel import inner_kernel
from planner.mechanics.contacts import Contacts
from planner.mechanics.lcp import PIVOT_LIMIT, SOLVED
from planner.mechanics.step import StepWork, rotate_surface, solve

DIRECTION_TOLERANCE = 1e-6  # Change of the unit wrench at convergence
MOST_ITERATIONS = 60
DAMPED_FROM = 8
"""Iteration from which the wrench moves half way: otherwise two modes of sliding may alternate."""


@inner_kernel
def local_matrix(table: Array, F: Array, out: Array) -> None:
    """Writes A(F) = hess H(F) / 3 of a quartic into `out` (3, 3), for the wrench F (3,) in the part's frame.

    The rows of `table` (6, 6) are the entries xx, xy, xz, yy, yz, zz of hess H, as coefficients of the six
    products of two components of F.
    """
    for row in range(6):
        i = 0 if row < 3 else (1 if row < 5 else 2)
        j = row if row < 3 else (row - 2 if row < 5 else 2)
        entry = (
            table[row, 0] * F[0] * F[0] + table[row, 1] * F[0] * F[1] + table[row, 2] * F[0] * F[2]
        )
        entry += (
            table[row, 3] * F[1] * F[1] + table[row, 4] * F[1] * F[2] + table[row, 5] * F[2] * F[2]
        )
        out[i, j] = entry / 3.0
        out[j, i] = entry / 3.0


@inner_kernel
def _wrench(contacts: Contacts, count: int, c: float, s: float, F: Array) -> float:
    """Sums all contact forces to a wrench in the part's frame, and returns the wrench's length.

    The wrench, divided by its length, is written into `F` (3,).
    """
    f0, f1, f2 = 0.0, 0.0, 0.0
    for k in range(count):
        contact = contacts[k]
        fn, ft = contact.fn, contact.ft
        f0 += fn * contact.nx - ft * contact.ny
        f1 += fn * contact.ny + ft * contact.nx
        f2 += fn * contact.n2 + ft * contact.t2
    length = np.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    if length > 0.0:
        F[0], F[1], F[2] = (c * f0 + s * f1) / length, (c * f1 - s * f0) / length, f2 / length
    return float(length)


@inner_kernel
def solve_surface(
    surface: Array, c: float, s: float, mu_top: float, mu_bottom: float, count: int, work: StepWork
) -> int:
    """Solves the step for a part turned by an angle of cosine c and sine s; returns a status (`step.solve`).

    `surface` is the matrix (3, 3) of an ellipsoid or the table (6, 6) of a quartic, in the part's frame.
    `work.A` receives the matrix of the last LCP. For a quartic the sequence of LCPs starts from the wrench in
    `work.F`, which then receives the wrench of the last LCP. The status is `PIVOT_LIMIT` also where the
    sequence does not converge.
    """
    A, F = work.A, work.F
    if surface.shape[0] == 3:
        rotate_surface(surface, c, s, A)
        return solve(mu_top, mu_bottom, count, work)
    for iteration in range(MOST_ITERATIONS):
        local_matrix(surface, F, work.local)
        rotate_surface(work.local, c, s, A)
        status = solve(mu_top, mu_bottom, count, work)
        if status != SOLVED:
            return status
        x, y, z = F[0], F[1], F[2]
        if _wrench(work.contacts, count, c, s, F) == 0.0:
            return SOLVED
        if (F[0] - x) ** 2 + (F[1] - y) ** 2 + (F[2] - z) ** 2 <= DIRECTION_TOLERANCE**2:
            return SOLVED
        if iteration >= DAMPED_FROM:
            F[0], F[1], F[2] = F[0] + x, F[1] + y, F[2] + z
            length = np.sqrt(F[0] ** 2 + F[1] ** 2 + F[2] ** 2)
            if length == 0.0:
                F[0], length = 1.0, 1.0
            F[0], F[1], F[2] = F[0] / length, F[1] / length, F[2] / length
    return PIVOT_LIMIT
