"""Lemke's method gives published answers, and agrees with trying all bases and all contact modes."""

import numpy as np
import pytest
from contact_problems import HAVE_MOTION, HAVE_NONE, lcp, random_contacts, wrenches
from lcp_twin import all_bases, motions, solve
from scipy.optimize import linprog

from planner.mechanics.lcp import RAY, SOLVED, residual

pytestmark = pytest.mark.slow


def assert_solved(M: np.ndarray, q: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
    """Solves the LCP by Lemke's method and checks the three conditions of a solution; returns z.

    The tolerance is relative to the size of the solution.
    """
    status, z = solve(M, q)
    assert status == SOLVED
    w = M @ z + q
    scale = 1.0 + np.abs(z).max() * np.abs(M).max()
    assert z.min() >= 0.0
    assert w.min() >= -tolerance * scale
    assert np.minimum(z, np.abs(w)).max() <= tolerance * scale
    assert residual(M, q, z, len(q)) <= tolerance * scale
    return z


def exponential(order):
    """A matrix of the given order n, with ones on the diagonal and twos below it.

    With q = -1, Lemke's method needs 2^n pivots if it chooses the worst row in each tie.
    """
    return np.eye(order) + 2.0 * np.tril(np.ones((order, order)), -1)


@pytest.mark.parametrize(
    ("M", "q", "expected"),
    [
        # K. G. Murty, Linear Complementarity, Linear and Nonlinear Programming (1988), chapters 2 and 6.
        (
            [[1, -1, -1, -1], [-1, 1, -1, -1], [1, 1, 2, 0], [1, 1, 0, 2]],
            [3, 5, -9, -5],
            [2, 1, 3, 1],
        ),
        ([[-1, 0, -3], [1, -2, -5], [-2, -1, -2]], [-3, -2, -1], None),
        (exponential(8), -np.ones(8), np.eye(8)[0]),
        # M. M. Kostreva, Cycling in linear complementarity problems, Mathematical Programming 16 (1979).
        ([[1, 2, 0], [0, 1, 2], [2, 0, 1]], [-1, -1, -1], [1 / 3] * 3),
        ([[1, -1, 3], [2, -1, 3], [-1, -2, 0]], [-1, -1, -1], None),
    ],
    ids=["2.8", "2.9 ends on a ray", "exponential", "tie of a P-matrix", "tie without a solution"],
)
def test_lemke_published_problem_gives_the_published_answer(M, q, expected):
    M, q = np.array(M, float), np.array(q, float)
    if expected is None:
        assert solve(M, q)[0] == RAY
    else:
        assert np.allclose(assert_solved(M, q), expected)


def random_problem(rng: np.random.Generator, kind: str) -> tuple[np.ndarray, np.ndarray]:
    n = int(rng.integers(1, 7))
    skew, root = rng.normal(size=(2, n, n))
    if kind == "P":
        return root @ root.T + 0.1 * np.eye(n) + skew - skew.T, rng.normal(size=n)
    if kind == "degenerate semidefinite":
        root, skew = rng.integers(-1, 2, (2, n, n)).astype(float)
        return root @ root.T + skew - skew.T, rng.integers(-2, 2, n).astype(float)
    return rng.integers(-2, 3, (n, n)).astype(float), rng.integers(-2, 2, n).astype(float)


@pytest.mark.parametrize("kind", ["P", "degenerate semidefinite", "integer"])
def test_lemke_random_problem_agrees_with_all_bases(kind):
    """Problems with a P-matrix, and solvable ones with a semidefinite matrix, are solved; none makes a cycle.

    Cottle, Pang & Stone, The Linear Complementarity Problem (1992), theorems 3.3.7 and 4.4.1.
    """
    rng = np.random.default_rng(1)
    for _ in range(300):
        M, q = random_problem(rng, kind)
        bases = all_bases(M, q)
        if solve(M, q)[0] == SOLVED:
            z = assert_solved(M, q)
            assert np.abs(bases - z).max(axis=1).min() < 1e-6 or kind != "P"
            assert len(bases)
        else:
            assert solve(M, q)[0] == RAY
            assert kind == "integer" or not len(bases)


def motion_of(problem, z: np.ndarray) -> np.ndarray:
    N, T = wrenches(problem)
    m = len(N)
    return problem.A @ (N.T @ z[:m] + T.T @ (z[m : 2 * m] - z[2 * m : 3 * m]))


def squeezing_power(problem) -> float:
    """The most work that the fingers do through contact forces that balance and lie in the friction cones.

    The normal forces add up to 1. The result is -inf if there are no such forces. If it is positive, the
    forces can grow without bound and nothing moves: the part is held. For a copositive matrix, a ray of
    Lemke's method means that the result is positive (Cottle, Pang & Stone, theorem 4.4.9).
    """
    m = len(problem.gap)
    M, q = lcp(problem)
    N, T = wrenches(problem)
    W = np.concatenate([N, T, -T]).T  # (3, 3 m)
    total = np.concatenate([np.ones(m), np.zeros(2 * m)])[None]
    balance, cone = np.concatenate([W, total]), -M[3 * m :, : 3 * m]
    best = linprog(q[: 3 * m], cone, np.zeros(m), balance, np.array([0, 0, 0, 1.0]))
    return -best.fun if best.success else -np.inf


@pytest.mark.parametrize("name", [*HAVE_MOTION, *HAVE_NONE])
def test_lemke_named_contacts_agrees_with_all_modes(name):
    """Some problems have repeated contacts, or faces on faces: their matrices are singular."""
    problem = (HAVE_MOTION | HAVE_NONE)[name]()
    status, z = solve(*lcp(problem))
    assert status == (SOLVED if name in HAVE_MOTION else RAY)
    assert (len(motions(problem)) > 0) == (status == SOLVED)
    assert status == RAY or np.allclose(motions(problem), motion_of(problem, z), atol=1e-9)


@pytest.mark.parametrize(("contacts", "count"), [(1, 100), (2, 300), (3, 300), (4, 100)])
def test_lemke_random_contacts_agrees_with_all_modes(contacts, count):
    """A solution is the motion of a consistent contact mode. If there is only a ray, the part is held."""
    rng = np.random.default_rng(contacts)
    for _ in range(count):
        problem = random_contacts(rng, contacts)
        status, z = solve(*lcp(problem))
        if status == SOLVED:
            assert np.abs(motions(problem) - motion_of(problem, z)).max(axis=1).min() < 1e-7
        else:
            assert status == RAY
            assert squeezing_power(problem) > 0.0
