"""Two slow methods that solve the LCP of a contact step: all bases, and all modes of contact."""

import itertools

import numpy as np
from contact_problems import ContactProblem, goals, wrenches

from planner.mechanics.lcp import lemke

SEPARATE, STICK, SLIDE_FORWARD, SLIDE_BACK = range(4)
TOLERANCE = 1e-9


def solve(M: np.ndarray, q: np.ndarray) -> tuple[int, np.ndarray]:
    """Solves the LCP of M (n, n) and q (n,) by the planner's own kernel; returns the status and z (n,)."""
    n = len(q)
    z = np.zeros(n)
    status = int(lemke(M, q, n, np.empty((n, 2 * n + 2)), np.empty(n, np.int64), z))
    return status, z


def all_bases(M: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Returns all basic solutions z (k, n) of the LCP: tries each subset of z as the basis.

    Singular bases are left out.
    """
    n = len(q)
    chosen = np.array(list(itertools.product([False, True], repeat=n)))  # (2^n, n)
    columns = np.where(chosen[:, None, :], -M, np.eye(n))  # w - M z = q
    determinant = np.linalg.det(columns)
    regular = np.abs(determinant) > 1e-12 * np.abs(columns).max(axis=(1, 2)) ** n
    sides = np.broadcast_to(q, (regular.sum(), n))[..., None]
    values = np.linalg.solve(columns[regular], sides)[..., 0]
    feasible = (values >= -TOLERANCE).all(axis=1)
    return np.where(chosen[regular][feasible], values[feasible], 0.0)


def motions(problem: ContactProblem) -> np.ndarray:
    """Returns all motions (k, 3) of the part that satisfy eqs 1-5, one for each consistent mode.

    In a mode, each of the m contacts separates, sticks, or slides in one of two directions. Each of the 4^m
    modes gives a linear system for the 2 m forces.
    """
    m = len(problem.gap)
    N, T = wrenches(problem)
    normal, tangential = goals(problem)
    modes = np.array(list(itertools.product(range(4), repeat=m)))  # (K, m)
    # Friction opposes the slip.
    sense = np.select([modes == SLIDE_FORWARD, modes == SLIDE_BACK], [-1.0, 1.0])
    system = np.zeros((len(modes), 2 * m, 2 * m))
    target = np.zeros((len(modes), 2 * m))
    W = np.empty((2 * m, 3))
    W[0::2], W[1::2] = N, T
    rows_n, rows_t = N @ problem.A @ W.T, T @ problem.A @ W.T
    for i in range(m):
        touching, stick = modes[:, i] != SEPARATE, modes[:, i] == STICK
        system[touching, 2 * i] = rows_n[i]
        system[~touching, 2 * i, 2 * i] = 1.0
        target[touching, 2 * i] = normal[i]
        system[stick, 2 * i + 1] = rows_t[i]
        target[stick, 2 * i + 1] = tangential[i]
        system[~stick, 2 * i + 1, 2 * i + 1] = 1.0
        system[~stick, 2 * i + 1, 2 * i] = -(sense[:, i] * problem.mu[i])[~stick]
    regular = np.linalg.cond(system) < 1e12
    forces = np.linalg.solve(system[regular], target[regular][..., None])[..., 0]
    V = forces @ W @ problem.A
    fn, ft = forces[:, 0::2], forces[:, 1::2]
    opening, slip = V @ N.T - normal, V @ T.T - tangential
    sense, stick = sense[regular], modes[regular] == STICK
    consistent = (
        (fn >= -TOLERANCE)
        & (opening >= -TOLERANCE)
        & (np.abs(ft) <= problem.mu * fn + TOLERANCE)
        & (sense * slip <= TOLERANCE)
    )
    separate = modes[regular] == SEPARATE
    pressed_or_open = np.where(separate, True, np.abs(opening) <= 1e-7)
    return V[(consistent & pressed_or_open & (stick | (sense != 0.0) | separate)).all(axis=1)]
