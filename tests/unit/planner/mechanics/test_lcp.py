"""Lemke's method on textbook problems, against all bases, and on ten thousand contact problems."""

import numpy as np
import pytest
from contact_problems import lcp, random_contacts, wrenches
from lcp_twin import all_bases, motions, solve
from scipy.optimize import linprog

from planner.mechanics.lcp import RAY, SOLVED, residual

pytestmark = pytest.mark.slow


def assert_solved(M: np.ndarray, q: np.ndarray, tolerance: float = 1e-9) -> np.ndarray:
    """The three conditions themselves, relative to the size of the answer."""
    status, z = solve(M, q)
    assert status == SOLVED
    w = M @ z + q
    scale = 1.0 + np.abs(z).max() * np.abs(M).max()
    assert z.min() >= 0.0
    assert w.min() >= -tolerance * scale
    assert np.minimum(z, np.abs(w)).max() <= tolerance * scale
    assert residual(M, q, z, len(q)) <= tolerance * scale
    return z


# Katta G. Murty, Linear Complementarity, Linear and Nonlinear Programming (1988), chapters 2 and 6.


def test_murty_example_2_8():
    M = np.array([[1.0, -1, -1, -1], [-1, 1, -1, -1], [1, 1, 2, 0], [1, 1, 0, 2]])
    q = np.array([3.0, 5, -9, -5])
    assert np.allclose(assert_solved(M, q), [2, 1, 3, 1])


def test_murty_example_2_9_ends_on_a_ray():
    M = np.array([[-1.0, 0, -3], [1, -2, -5], [-2, -1, -2]])
    assert solve(M, np.array([-3.0, -2, -1]))[0] == RAY


def test_murty_example_2_11_is_solved_with_the_vector_of_ones():
    """With d = (5, 16) the method ends on a ray although there is a solution; with ones it finds it."""
    assert_solved(np.array([[-1.5, 2.0], [-4.0, 4.0]]), np.array([-5.0, 17.0]))


@pytest.mark.parametrize("order", [3, 6, 8])
def test_murty_exponential_example(order):
    """Twos below the diagonal, q = -1: 2^n pivots for the worst rule, the answer is (1, 0, ...)."""
    M = np.eye(order) + 2.0 * np.tril(np.ones((order, order)), -1)
    z = assert_solved(M, -np.ones(order))
    assert np.allclose(z, np.eye(order)[0])


# M. M. Kostreva, Cycling in linear complementarity problems, Mathematical Programming 16 (1979).


def test_kostreva_example_1_does_not_cycle():
    """A P-matrix with a threefold tie at the start."""
    M = np.array([[1.0, 2, 0], [0, 1, 2], [2, 0, 1]])
    assert np.allclose(assert_solved(M, -np.ones(3)), 1 / 3)


def test_kostreva_example_2_does_not_cycle():
    """No solution, and a threefold tie at the start: the method must say so rather than run in a circle."""
    M = np.array([[1.0, -1, 3], [2, -1, 3], [-1, -2, 0]])
    q = -np.ones(3)
    assert len(all_bases(M, q)) == 0
    assert solve(M, q)[0] == RAY


# Cottle, Pang & Stone, The Linear Complementarity Problem (1992), chapter 4: what Lemke's method promises.


def random_problem(rng: np.random.Generator, kind: str) -> tuple[np.ndarray, np.ndarray]:
    n = int(rng.integers(1, 7))
    skew = rng.normal(size=(n, n))
    root = rng.normal(size=(n, n))
    if kind == "P":
        return root @ root.T + 0.1 * np.eye(n) + skew - skew.T, rng.normal(size=n)
    if kind == "degenerate semidefinite":
        root, skew = rng.integers(-1, 2, (2, n, n)).astype(float)
        return root @ root.T + skew - skew.T, rng.integers(-2, 2, n).astype(float)
    return rng.integers(-2, 3, (n, n)).astype(float), rng.integers(-2, 2, n).astype(float)


def test_against_all_bases_for_p_matrices():
    """One solution each (Cottle, Pang & Stone, theorem 3.3.7), and it is found."""
    rng = np.random.default_rng(1)
    for _ in range(1000):
        M, q = random_problem(rng, "P")
        assert np.allclose(all_bases(M, q), assert_solved(M, q), atol=1e-6)


def test_against_all_bases_for_degenerate_semidefinite_matrices():
    """Solved if and only if there is a solution (theorem 4.4.1: copositive-plus), ties or not."""
    rng = np.random.default_rng(2)
    for _ in range(1500):
        M, q = random_problem(rng, "degenerate semidefinite")
        if len(all_bases(M, q)):
            assert_solved(M, q)
        else:
            assert solve(M, q)[0] == RAY


def test_small_integer_matrices_never_cycle():
    """Any sign pattern, ties everywhere: an answer is right, and there always is an end."""
    rng = np.random.default_rng(3)
    for _ in range(1500):
        M, q = random_problem(rng, "integer")
        if solve(M, q)[0] == SOLVED:
            assert_solved(M, q)
            assert len(all_bases(M, q))
        else:
            assert solve(M, q)[0] == RAY


# The contact problems of the paper (eqs 1-5).


def motion_of(problem, z: np.ndarray) -> np.ndarray:
    N, T = wrenches(problem)
    m = len(N)
    return problem.A @ (N.T @ z[:m] + T.T @ (z[m : 2 * m] - z[2 * m : 3 * m]))


def squeezing_power(problem) -> float:
    """Most work that the fingers can do on forces in the friction cones that balance among themselves.

    Cottle, Pang & Stone, theorem 4.4.9: for a copositive matrix a ray means that it is positive, so that
    these forces can grow without bound and nothing moves: the part is held.
    """
    m = len(problem.gap)
    M, q = lcp(problem)
    N, T = wrenches(problem)
    W = np.concatenate([N, T, -T]).T  # (3, 3 m)
    cone = -M[3 * m :, : 3 * m]
    total = np.concatenate([np.ones(m), np.zeros(2 * m)])[None]
    best = linprog(
        q[: 3 * m], cone, np.zeros(m), np.concatenate([W, total]), np.array([0, 0, 0, 1.0])
    )
    return -best.fun if best.success else -np.inf


@pytest.mark.parametrize(("contacts", "count"), [(1, 2000), (2, 4000), (3, 3000), (4, 1000)])
def test_ten_thousand_contact_problems_against_all_modes(contacts, count):
    """A solution is the motion of a consistent mode; a ray is a jam with a certificate."""
    rng = np.random.default_rng(contacts)
    for _ in range(count):
        problem = random_contacts(rng, contacts)
        M, q = lcp(problem)
        others = motions(problem)
        status, z = solve(M, q)
        if status == SOLVED:
            distance = np.abs(others - motion_of(problem, z)).max(axis=1)
            assert distance.min() < 1e-7
        else:
            assert status == RAY
            assert squeezing_power(problem) > 0.0
