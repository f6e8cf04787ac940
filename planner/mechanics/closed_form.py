"""Solves the step for one, two or three contacts in closed form: tries the modes of sliding and sticking.

N and T are the wrench directions of a contact along its normal and its tangent, mu is its friction, and A is
the matrix of the limit surface; see `planner.mechanics.step`, also for the equations.

In a mode, each contact either slides or sticks. A contact that slides in the sense s = +-1 has a force of
unknown magnitude along N + s mu T, and one condition on the motion, along N. A contact that sticks has
unknown forces along N and T, and conditions along N and T. With G = [N T]^T A [N T], every mode is a linear
system of order one to three. Its solution solves eqs 3-5 if the forces and slips have the right signs.

The mode in which two contacts stick has more conditions than the motion has components; it is left out, since
the neighbouring modes cover it. Where three contacts slide, their normals determine the motion, the motion
determines the senses of the slips, and the senses determine the forces.
"""

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inlined_kernel, inner_kernel
from planner.mechanics.contacts import Contact, Contacts
from planner.mechanics.lcp import RAY, SOLVED

SLIP_TOLERANCE_MM = 1e-10
LARGEST_FORCE = 1e3
"""Force above which three contacts nearly hold the part, so that Lemke's method decides.

A force of 1 moves the part by about 1 mm.
"""


@inlined_kernel
def form(A: Array, f0: float, f1: float, f2: float, g0: float, g1: float, g2: float) -> float:
    """The product f . A g of two wrenches f and g, given by their components."""
    return float(
        f0 * (A[0, 0] * g0 + A[0, 1] * g1 + A[0, 2] * g2)
        + f1 * (A[1, 0] * g0 + A[1, 1] * g1 + A[1, 2] * g2)
        + f2 * (A[2, 0] * g0 + A[2, 1] * g1 + A[2, 2] * g2)
    )


@inlined_kernel
def one_contact(A: Array, contact: Contact, mu: float) -> int:
    """Finds the force at a single contact by eqs 1-5: the contact sticks, or else slides.

    A (3, 3) is the matrix of the limit surface in the hand frame. The forces of the contact are modified in
    place. Returns `SOLVED`, or `RAY` if the contact can neither stick nor slide.
    """
    nx, ny, n2, t2 = contact.nx, contact.ny, contact.n2, contact.t2
    a = form(A, nx, ny, n2, nx, ny, n2)
    b = form(A, nx, ny, n2, -ny, nx, t2)
    c = form(A, -ny, nx, t2, -ny, nx, t2)
    un, ut = contact.un - contact.gap, contact.ut
    determinant = a * c - b * b
    fn, ft = (c * un - b * ut) / determinant, (a * ut - b * un) / determinant
    if abs(ft) <= mu * fn:
        contact.fn, contact.ft = fn, ft
        return SOLVED
    first = 1.0 if ft > 0.0 else -1.0
    for sign in (first, -first):
        fn = un / (a + sign * mu * b)
        if fn >= 0.0 and sign * (fn * (b + sign * mu * c) - ut) <= SLIP_TOLERANCE_MM:
            contact.fn, contact.ft = fn, sign * mu * fn
            return SOLVED
    return RAY


@inlined_kernel
def _gram(A: Array, i: Contact, j: Contact, G: Array) -> None:
    """Writes the matrix W^T A W of two contacts, with W = [N_i, T_i, N_j, T_j], into `G` (4, 4)."""
    for p in range(4):
        one, tangent = (i if p < 2 else j), p % 2 == 1
        f0, f1 = (-one.ny, one.nx) if tangent else (one.nx, one.ny)
        f2 = one.t2 if tangent else one.n2
        for r in range(p, 4):
            other, along = (i if r < 2 else j), r % 2 == 1
            g0, g1 = (-other.ny, other.nx) if along else (other.nx, other.ny)
            g2 = other.t2 if along else other.n2
            G[p, r] = form(A, f0, f1, f2, g0, g1, g2)
            G[r, p] = G[p, r]


@inlined_kernel
def _both_slide(
    i: Contact, j: Contact, mu_i: float, mu_j: float, si: float, sj: float, G: Array
) -> bool:
    """Tries the mode in which contacts i and j slide with the senses si and sj, 1 or -1.

    Returns:
        Whether the mode is consistent; if so, the forces are stored in the contacts.
    """
    a, b = G[0, 0] + si * mu_i * G[0, 1], G[0, 2] + sj * mu_j * G[0, 3]
    c, d = G[2, 0] + si * mu_i * G[2, 1], G[2, 2] + sj * mu_j * G[2, 3]
    p, r = i.un - i.gap, j.un - j.gap
    determinant = a * d - b * c
    if abs(determinant) <= 1e-12 * (abs(a * d) + abs(b * c)):
        return False
    fi, fj = (d * p - b * r) / determinant, (a * r - c * p) / determinant
    if fi < 0.0 or fj < 0.0:
        return False
    ti, tj = si * mu_i * fi, sj * mu_j * fj
    slip_i = G[1, 0] * fi + G[1, 1] * ti + G[1, 2] * fj + G[1, 3] * tj - i.ut
    slip_j = G[3, 0] * fi + G[3, 1] * ti + G[3, 2] * fj + G[3, 3] * tj - j.ut
    if si * slip_i > SLIP_TOLERANCE_MM or sj * slip_j > SLIP_TOLERANCE_MM:
        return False
    i.fn, i.ft, j.fn, j.ft = fi, ti, fj, tj
    return True


@inlined_kernel
def _one_sticks(
    i: Contact, j: Contact, o: int, mu_i: float, mu_j: float, sj: float, G: Array
) -> bool:
    """Tries the mode in which contact i sticks while contact j slides with sense sj.

    Args:
        i: the sticking contact.
        j: the sliding contact.
        o: row of contact i's normal in G: 0 if i is the first contact of G, 2 if i is the second.
        mu_i: friction coefficient of contact i.
        mu_j: friction coefficient of contact j.
        sj: sense of the slip at contact j, 1 or -1.
        G: (4, 4) W^T A W, as written by `_gram`.

    Returns:
        Whether the mode is consistent; if so, the forces are stored in the contacts.
    """
    v = 2 - o
    a00, a01, a02 = G[o, o], G[o, o + 1], G[o, v] + sj * mu_j * G[o, v + 1]
    a10, a11, a12 = G[o + 1, o], G[o + 1, o + 1], G[o + 1, v] + sj * mu_j * G[o + 1, v + 1]
    a20, a21, a22 = G[v, o], G[v, o + 1], G[v, v] + sj * mu_j * G[v, v + 1]
    p, r, w = i.un - i.gap, i.ut, j.un - j.gap
    m0, m1, m2 = a11 * a22 - a12 * a21, a10 * a22 - a12 * a20, a10 * a21 - a11 * a20
    determinant = a00 * m0 - a01 * m1 + a02 * m2
    if abs(determinant) <= 1e-10 * (abs(a00 * m0) + abs(a01 * m1) + abs(a02 * m2)):
        return False
    fi = (p * m0 - a01 * (r * a22 - a12 * w) + a02 * (r * a21 - a11 * w)) / determinant
    ti = (a00 * (r * a22 - a12 * w) - p * m1 + a02 * (a10 * w - r * a20)) / determinant
    fj = (a00 * (a11 * w - r * a21) - a01 * (a10 * w - r * a20) + p * m2) / determinant
    if fj < 0.0 or abs(ti) > mu_i * fi:
        return False
    tj = sj * mu_j * fj
    slip = G[v + 1, o] * fi + G[v + 1, o + 1] * ti + G[v + 1, v] * fj + G[v + 1, v + 1] * tj - j.ut
    if sj * slip > SLIP_TOLERANCE_MM:
        return False
    i.fn, i.ft, j.fn, j.ft = fi, ti, fj, tj
    return True


@inlined_kernel
def two_contacts(A: Array, i: Contact, j: Contact, mu_i: float, mu_j: float, G: Array) -> int:
    """Finds the forces at contacts i and j by eqs 1-5, if both press; G is a (4, 4) workspace.

    The forces are stored in the contacts. Returns `SOLVED`, or `RAY` where no mode in which both contacts
    press is consistent. See `one_contact` for A.
    """
    _gram(A, i, j, G)
    for si in (1.0, -1.0):
        for sj in (1.0, -1.0):
            if _both_slide(i, j, mu_i, mu_j, si, sj, G):
                return SOLVED
    for s in (1.0, -1.0):
        if _one_sticks(i, j, 0, mu_i, mu_j, s, G) or _one_sticks(j, i, 2, mu_j, mu_i, s, G):
            return SOLVED
    return RAY


@inner_kernel
def _linear(G: Array, b0: float, b1: float, b2: float) -> tuple[float, float, float]:
    """Solves G x = b for the leading (3, 3) of G by cofactors; returns x, infinite if G is singular."""
    c0 = G[1, 1] * G[2, 2] - G[1, 2] * G[2, 1]
    c1 = G[1, 2] * G[2, 0] - G[1, 0] * G[2, 2]
    c2 = G[1, 0] * G[2, 1] - G[1, 1] * G[2, 0]
    scale = abs(G[0, 0] * c0) + abs(G[0, 1] * c1) + abs(G[0, 2] * c2)
    determinant = G[0, 0] * c0 + G[0, 1] * c1 + G[0, 2] * c2
    if abs(determinant) <= 1e-10 * scale:
        return np.inf, np.inf, np.inf
    p, q, r = b1 * G[2, 0] - b2 * G[1, 0], b1 * G[2, 1] - b2 * G[1, 1], b1 * G[2, 2] - b2 * G[1, 2]
    return (
        (b0 * c0 - G[0, 1] * r + G[0, 2] * q) / determinant,
        (b0 * c1 + G[0, 0] * r - G[0, 2] * p) / determinant,
        (b0 * c2 - G[0, 0] * q + G[0, 1] * p) / determinant,
    )


@inner_kernel
def three_contacts(
    A: Array, contacts: Contacts, active: IntArray, mu_top: float, mu_bottom: float, G: Array
) -> int:
    """Finds the forces at the three active contacts by eqs 1-5, if all press and slide.

    The forces are stored in the contacts; G is a (4, 4) workspace. Returns `SOLVED`, or `RAY` where this mode
    is inconsistent. `RAY` also results where the mode is nearly singular: the normals are dependent, a slip
    is too small to have a sign, or a force is very large.
    """
    for a in range(3):
        contact = contacts[active[a]]
        G[a, 0], G[a, 1], G[a, 2] = contact.nx, contact.ny, contact.n2
        G[a, 3] = contact.un - contact.gap
    v0, v1, v2 = _linear(G, G[0, 3], G[1, 3], G[2, 3])
    if v0 == np.inf:
        return RAY
    for a in range(3):
        contact = contacts[active[a]]
        slip = contact.nx * v1 - contact.ny * v0 + contact.t2 * v2 - contact.ut
        if abs(slip) <= SLIP_TOLERANCE_MM:
            return RAY
        mu = mu_top if contact.finger == 1 else mu_bottom
        G[3, a] = -mu if slip > 0.0 else mu
        d0 = contact.nx - G[3, a] * contact.ny
        d1 = contact.ny + G[3, a] * contact.nx
        d2 = contact.n2 + G[3, a] * contact.t2
        for p in range(3):
            G[p, a] = A[p, 0] * d0 + A[p, 1] * d1 + A[p, 2] * d2
    f0, f1, f2 = _linear(G, v0, v1, v2)
    if min(f0, f1, f2) < 0.0 or max(f0, f1, f2) > LARGEST_FORCE:
        return RAY
    for a, f in ((0, f0), (1, f1), (2, f2)):
        contacts[active[a]].fn, contacts[active[a]].ft = f, G[3, a] * f
    return SOLVED


@inlined_kernel
def motion(A: Array, contacts: Contacts, active: IntArray, m: int, V: Array) -> None:
    """Writes the part's motion V = A F under the forces of the m active contacts (eqs 1, 2) into `V` (3,)."""
    F0, F1, F2 = 0.0, 0.0, 0.0
    for a in range(m):
        contact = contacts[active[a]]
        fn, ft = contact.fn, contact.ft
        F0 += fn * contact.nx - ft * contact.ny
        F1 += fn * contact.ny + ft * contact.nx
        F2 += fn * contact.n2 + ft * contact.t2
    for p in range(3):
        V[p] = A[p, 0] * F0 + A[p, 1] * F1 + A[p, 2] * F2
