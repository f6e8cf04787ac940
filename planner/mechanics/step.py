"""One quasi-static step: the part's displacement while the fingers advance (paper, eqs 1-5).

The step is posed in displacements, not in velocities. With the ellipsoid limit surface, eq. 1 reads V = A F
up to a positive factor that the forces absorb. So for wrench directions N_i (normal) and T_i (tangent)

    V = A sum_i (f_n N_i + f_t T_i)                                                     (1, 2)
    0 <= f_n  _|_  gap_i + N_i . V - u_n        >= 0                                     (3)
    0 <= f_t+ _|_  (T_i . V - u_t) + lambda_i   >= 0                                     (4)
    0 <= f_t- _|_ -(T_i . V - u_t) + lambda_i   >= 0                                     (4)
    0 <= lambda_i _|_ mu f_n - f_t+ - f_t-      >= 0                                     (5)

where V is the displacement of the part and u that of the finger or pusher. The gap in eq. 3 lets contacts
close within the step, and removes drift. Twists and wrenches are normalised: V = (dx, dy, rho dtheta), F =
(f_x, f_y, tau / rho).
"""

from typing import Any, TypeAlias

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inlined_kernel, inner_kernel
from planner.mechanics.closed_form import form, motion, one_contact, three_contacts, two_contacts
from planner.mechanics.contacts import CONTACT, MAX_CONTACTS, Contact, Contacts
from planner.mechanics.lcp import PIVOT_LIMIT, RAY, SOLVED, lemke, residual

TOUCHING_MM = 1e-3  # Gap below which contacts enter the step; the others are awaited as events
PAST_END_MM = 1e-4  # Distance past the end of its feature at which a contact ends
UNBOUNDED = 1e7
"""Force above which a solution counts as a ray with rounding errors.

A force of 1 moves the part by about 1 mm.
"""
RESIDUAL = 5e-5  # Largest complementarity residual of an accepted solution [mm]
ATTEMPTS = 3
PERTURBATION_MM = 1e-8
"""Least change of q where rounding defeats the lexicographic order, since flush grasps are degenerate."""
LARGEST_ESCAPE_MM = 1e4
"""Motion above which a part counts as blocked: exactly opposed contacts must not depend on rounding."""
OVERLAP_MM = 1e-7  # Tolerated overlap of a contact outside the active set after a step


_N = 4 * MAX_CONTACTS
STEP_WORK = np.dtype(
    [
        ("contacts", CONTACT, MAX_CONTACTS),
        ("A", np.float64, (3, 3)),
        ("local", np.float64, (3, 3)),
        ("F", np.float64, 3),
        ("V", np.float64, 3),
        ("M", np.float64, (_N, _N)),
        ("q", np.float64, _N),
        ("tableau", np.float64, (_N, 2 * _N + 2)),
        ("basis", np.int64, _N),
        ("z", np.float64, _N),
        ("active", np.int64, MAX_CONTACTS),
        ("G", np.float64, (4, 4)),
    ],
    align=True,
)
"""Workspace of `solve`.

contacts: the contacts of the step. A: matrix of the ellipsoid, or local matrix of the quartic, in the hand
frame. local: local matrix of the quartic in the part's frame. F: unit wrench of the last step, in the part's
frame. V: the displacement of the part. M, q, tableau, basis, z: the LCP. active: indices of the contacts that
the LCP or a closed form takes into account. G: matrix of the closed forms.

A record is passed to kernels as one pointer, without reference counting (decision 0005).
"""
StepWork: TypeAlias = Any


@inlined_kernel
def rotate_surface(A: Array, c: float, s: float, out: Array) -> None:
    """Rotates the matrix A (3, 3) of a limit surface from the part's frame to the hand frame.

    The part is turned by an angle of cosine c and sine s. The result is written into `out` (3, 3).
    """
    a, b, d = A[0, 0], A[0, 1], A[1, 1]
    out[0, 0] = c * c * a - 2.0 * c * s * b + s * s * d
    out[1, 1] = s * s * a + 2.0 * c * s * b + c * c * d
    out[0, 1] = c * s * (a - d) + (c * c - s * s) * b
    out[1, 0] = out[0, 1]
    out[0, 2] = c * A[0, 2] - s * A[1, 2]
    out[1, 2] = s * A[0, 2] + c * A[1, 2]
    out[2, 0], out[2, 1], out[2, 2] = out[0, 2], out[1, 2], A[2, 2]


@inner_kernel
def _assemble(mu_top: float, mu_bottom: float, work: StepWork, m: int) -> int:
    """Writes the LCP of the m active contacts into `work`; returns its order.

    The unknowns are f_n (m), f_t+ (m), f_t- (m) and lambda (m); without friction only f_n.
    """
    A, M, q, contacts, active = work.A, work.M, work.q, work.contacts, work.active
    order = 4 * m if mu_top > 0.0 or mu_bottom > 0.0 else m
    for i in range(order):
        for j in range(order):
            M[i, j] = 0.0
    for a in range(m):
        contact = contacts[active[a]]
        nx, ny, n2, t2 = contact.nx, contact.ny, contact.n2, contact.t2
        q[a] = contact.gap - contact.un
        for b in range(m):
            other = contacts[active[b]]
            px, py, p2, s2 = other.nx, other.ny, other.n2, other.t2
            if order == m:
                M[a, b] = form(A, nx, ny, n2, px, py, p2)
                continue
            nn, nt = form(A, nx, ny, n2, px, py, p2), form(A, nx, ny, n2, -py, px, s2)
            tn, tt = form(A, -ny, nx, t2, px, py, p2), form(A, -ny, nx, t2, -py, px, s2)
            M[a, b], M[a, m + b], M[a, 2 * m + b] = nn, nt, -nt
            M[m + a, b], M[m + a, m + b], M[m + a, 2 * m + b] = tn, tt, -tt
            M[2 * m + a, b], M[2 * m + a, m + b], M[2 * m + a, 2 * m + b] = -tn, -tt, tt
        if order == m:
            continue
        M[m + a, 3 * m + a] = M[2 * m + a, 3 * m + a] = 1.0
        M[3 * m + a, a] = mu_top if contact.finger == 1 else mu_bottom
        M[3 * m + a, m + a] = M[3 * m + a, 2 * m + a] = -1.0
        q[m + a], q[2 * m + a], q[3 * m + a] = -contact.ut, contact.ut, 0.0
    return order


@inner_kernel
def _judge(work: StepWork, m: int, order: int) -> int:
    """Checks the solution of Lemke's method in `work`.

    Returns:
        `SOLVED`; `RAY` if a force exceeds `UNBOUNDED`; `PIVOT_LIMIT` if the solution is inaccurate.
    """
    for a in range(m):
        if work.z[a] > UNBOUNDED:
            return RAY
    return SOLVED if residual(work.M, work.q, work.z, order) <= RESIDUAL else PIVOT_LIMIT


@inner_kernel
def _opposed(contacts: Contacts, active: IntArray, m: int) -> bool:
    """Whether the m active contacts oppose each other, so that no motion lets the fingers close.

    By Farkas' lemma eq. 3 has no solution V if some forces f >= 0 are in balance, sum f_i N_i = 0, and sum
    f_i (u_i - gap_i) > 0. The test tries one force from each finger, combined from the finger's outermost
    contacts, such that the two forces act along one line. Rounding errors leave a small sum of forces and
    moments; it counts as 0 if the motion V would have to exceed `LARGEST_ESCAPE_MM`.
    """
    top_low, top_high, bottom_low, bottom_high = -1, -1, -1, -1
    for a in range(m):
        k = active[a]
        x = contacts[k].x
        if contacts[k].finger == 1:
            top_low = k if top_low < 0 or x < contacts[top_low].x else top_low
            top_high = k if top_high < 0 or x > contacts[top_high].x else top_high
        else:
            bottom_low = k if bottom_low < 0 or x < contacts[bottom_low].x else bottom_low
            bottom_high = k if bottom_high < 0 or x > contacts[bottom_high].x else bottom_high
    if top_low < 0 or bottom_low < 0:
        return False
    leftmost = max(contacts[top_low].x, contacts[bottom_low].x)
    rightmost = min(contacts[top_high].x, contacts[bottom_high].x)
    line = 0.5 * (leftmost + rightmost)
    f0, f1, f2, gain = 0.0, 0.0, 0.0, 0.0
    for low, high in ((top_low, top_high), (bottom_low, bottom_high)):
        wide = contacts[high].x - contacts[low].x
        share = (line - contacts[low].x) / wide if wide > 0.0 else 0.0
        if share < 0.0 or share > 1.0:
            return False
        for k, f in ((low, 1.0 - share), (high, share)):
            contact = contacts[k]
            f0, f1, f2 = f0 + f * contact.nx, f1 + f * contact.ny, f2 + f * contact.n2
            gain += f * (contact.un - contact.gap)
    return bool(gain > LARGEST_ESCAPE_MM * np.sqrt(f0 * f0 + f1 * f1 + f2 * f2))


@inner_kernel
def _all_touching(mu_top: float, mu_bottom: float, count: int, work: StepWork) -> int:
    """Solves the step for all touching contacts; returns `SOLVED`, `RAY` or `PIVOT_LIMIT`.

    Opposed contacts and three sliding contacts have closed forms; else Lemke's method decides. For one or two
    contacts the result is `RAY`, since `_tried` has tried all their modes.
    """
    A, V, contacts = work.A, work.V, work.contacts
    m = 0
    for k in range(count):
        if contacts[k].gap <= TOUCHING_MM:
            work.active[m] = k
            m += 1
    if m <= 2 or _opposed(contacts, work.active, m):
        return RAY
    if m == 3 and three_contacts(A, contacts, work.active, mu_top, mu_bottom, work.G) == SOLVED:
        motion(A, contacts, work.active, 3, V)
        return SOLVED
    order = _assemble(mu_top, mu_bottom, work, m)
    status = PIVOT_LIMIT
    for attempt in range(ATTEMPTS):
        status = lemke(work.M, work.q, order, work.tableau, work.basis, work.z)
        if status == SOLVED:
            status = _judge(work, m, order)
        if status != PIVOT_LIMIT:
            break
        for i in range(order):
            work.q[i] += PERTURBATION_MM * (attempt + 1) * ((7 * i + 3) % order + 1)
    if status != SOLVED:
        return status
    for a in range(m):
        contact = contacts[work.active[a]]
        contact.fn = work.z[a]
        contact.ft = work.z[m + a] - work.z[2 * m + a] if order > m else 0.0
    motion(A, contacts, work.active, m, V)
    return SOLVED


@inlined_kernel
def _slack(contact: Contact, V: Array) -> float:
    """Gap of a contact after the displacement V [mm]."""
    left = contact.gap - contact.un
    return float(left + contact.nx * V[0] + contact.ny * V[1] + contact.n2 * V[2])


@inlined_kernel
def _most_violated(contacts: Contacts, count: int, V: Array) -> int:
    """Index of the touching contact that overlaps most after the displacement V; -1 if none overlaps."""
    worst, result = -OVERLAP_MM, -1
    for k in range(count):
        if contacts[k].gap <= TOUCHING_MM:
            slack = _slack(contacts[k], V)
            if slack < worst:
                worst, result = slack, k
    return result


@inlined_kernel
def _one_finger(contacts: Contacts, count: int) -> bool:
    """Whether all touching contacts belong to one finger."""
    finger = 0
    for k in range(count):
        if contacts[k].gap <= TOUCHING_MM:
            if finger != 0 and contacts[k].finger != finger:
                return False
            finger = contacts[k].finger
    return True


@inner_kernel
def _tried(mu_top: float, mu_bottom: float, count: int, work: StepWork) -> int:
    """Solves the step with few contacts in closed form, or else with all touching contacts at once.

    Contacts are added one by one, the most violated first, until none of the others overlaps. Most steps need
    one or two, which have closed forms.
    """
    A, V, contacts, active = work.A, work.V, work.contacts, work.active
    V[0] = V[1] = V[2] = 0.0
    for k in range(count):
        contacts[k].fn, contacts[k].ft = 0.0, 0.0
    first = _most_violated(contacts, count, V)
    if first < 0:
        return SOLVED
    mu_first = mu_top if contacts[first].finger == 1 else mu_bottom
    active[0] = first
    if one_contact(A, contacts[first], mu_first) == SOLVED:
        motion(A, contacts, active, 1, V)
        second = _most_violated(contacts, count, V)
        if second < 0:
            return SOLVED
        mu_second = mu_top if contacts[second].finger == 1 else mu_bottom
        active[1] = second
        i, j = contacts[first], contacts[second]
        if two_contacts(A, i, j, mu_first, mu_second, work.G) == SOLVED:
            motion(A, contacts, active, 2, V)
            if _most_violated(contacts, count, V) < 0:
                return SOLVED
        contacts[first].fn, contacts[first].ft = 0.0, 0.0
        active[0] = second
        if one_contact(A, contacts[second], mu_second) == SOLVED:
            motion(A, contacts, active, 1, V)
            if _most_violated(contacts, count, V) < 0:
                return SOLVED
    for k in range(count):
        contacts[k].fn, contacts[k].ft = 0.0, 0.0
    return _all_touching(mu_top, mu_bottom, count, work)


@inner_kernel
def solve(mu_top: float, mu_bottom: float, count: int, work: StepWork) -> int:
    """Solves the step for the touching contacts; returns `SOLVED`, `RAY` (part held) or `PIVOT_LIMIT`.

    `work` holds A and `count` contacts, with the values that `boundary.directions` computes; it receives the
    forces of the contacts and the displacement V (dx, dy, rho dtheta) [mm].

    A part can always move along with a single finger. But eq. 3 also requires that the part leaves an
    overlap, which is impossible where the finger is wedged in a notch. So if a single finger gives a ray, the
    step is solved once more with all overlaps counted as gaps of 0, so that they may remain.
    """
    status = _tried(mu_top, mu_bottom, count, work)
    if status == RAY and _one_finger(work.contacts, count):
        for k in range(count):
            work.contacts[k].gap = max(work.contacts[k].gap, 0.0)
        status = _tried(mu_top, mu_bottom, count, work)
    return status


@inlined_kernel
def along(first: Array, V: Array, f: float, i: int) -> float:
    """Component i of the part's displacement after a share f of a step: dense output of the midpoint rule.

    It interpolates, to second order, between the displacements of the Euler step (`first`) and of the
    midpoint rule (`V`) (Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.6).
    """
    return float(f * (first[i] + f * (V[i] - first[i])))


@inlined_kernel
def _reached(gap: float, rate: float, bend: float) -> float:
    """The least f > 0 at which gap + rate f + bend f^2 is zero; the sum must be negative at f = 1."""
    root = np.sqrt(max(rate * rate - 4.0 * bend * gap, 0.0))
    return float(2.0 * gap / (root - rate)) if root > rate else 1.0


@inlined_kernel
def event_fraction(contacts: Contacts, count: int, first: Array, V: Array) -> float:
    """Share of a step after which the first event happens; 1 without an event. See `along` for `first` and V.

    The events are: a contact that was open touches; a pressed contact slides off the end of its feature.
    """
    fraction = 1.0
    for k in range(count):
        contact = contacts[k]
        nx, ny, gap = contact.nx, contact.ny, contact.gap
        if gap > TOUCHING_MM:
            slack = _slack(contact, V)
            if slack < -OVERLAP_MM:
                rate = nx * first[0] + ny * first[1] + contact.n2 * first[2] - contact.un
                fraction = min(fraction, _reached(gap, rate, slack - gap - rate))
        elif contact.fn > 0.0:
            slip = nx * V[1] - ny * V[0] + contact.t2 * V[2] - contact.ut
            limit = (contact.high if slip > 0.0 else -contact.low) + PAST_END_MM
            if abs(slip) > limit:
                rate = nx * first[1] - ny * first[0] + contact.t2 * first[2] - contact.ut
                rate, slip = (-rate, -slip) if slip > 0.0 else (rate, slip)
                fraction = min(fraction, _reached(max(limit, 0.0), rate, slip - rate))
    return fraction
