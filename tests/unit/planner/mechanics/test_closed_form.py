"""The closed form of one to three contacts agrees with Lemke's method and with trying all contact modes."""

import contact_problems as problems
import numpy as np
import pytest
from lcp_twin import motions, solve

from planner.mechanics.closed_form import (
    LARGEST_FORCE,
    motion,
    one_contact,
    three_contacts,
    two_contacts,
)
from planner.mechanics.lcp import RAY, SOLVED
from planner.mechanics.step import PAST_END_MM, UNBOUNDED, along, event_fraction
from planner.mechanics.step import solve as solve_step

pytestmark = pytest.mark.slow


def closed_form(problem: problems.ContactProblem) -> tuple[int, np.ndarray, np.ndarray]:
    """Solves m = 1 to 3 contacts by the closed form, which assumes that all press.

    Returns:
        Status, motion (3,) and forces (m, 2).
    """
    contacts, A, mu, m = problems.rows(problem), problem.A, problem.mu, len(problem.gap)
    if m == 1:
        status = one_contact(A, contacts[0], mu[0])
    elif m == 2:
        status = two_contacts(A, contacts[0], contacts[1], mu[0], mu[1], np.zeros((4, 4)))
    else:
        status = three_contacts(A, contacts, np.arange(3), mu[0], mu[1], np.zeros((4, 4)))
    V = np.zeros(3)
    motion(A, contacts, np.arange(m), m, V)
    return status, V, np.column_stack([contacts["fn"][:m], contacts["ft"][:m]])


def assert_coulomb(problem: problems.ContactProblem, V: np.ndarray, forces: np.ndarray) -> None:
    """Checks eqs 1-5 for contacts that all press.

    The fingers touch and push the part. Friction stays in its cone and opposes the slip; at a contact that
    slips it is as large as the cone allows.
    """
    N, T = problems.wrenches(problem)
    normal, tangential = problems.goals(problem)
    fn, ft = forces.T
    slip = T @ V - tangential
    assert np.allclose(V, problem.A @ (N.T @ fn + T.T @ ft), atol=1e-12)
    assert np.allclose(N @ V, normal, atol=1e-8)
    assert fn.min() >= 0.0
    assert (np.abs(ft) <= problem.mu * fn + 1e-10).all()
    assert (ft * slip <= 1e-9).all()
    # A contact slips only where its friction is as large as the cone allows.
    assert (np.minimum(np.abs(slip), problem.mu * fn - np.abs(ft)) <= 1e-8).all()


def pressed_alone(rng: np.random.Generator) -> problems.ContactProblem:
    """One random contact whose finger moves towards the part."""
    while True:
        problem = problems.random_contacts(rng, 1)
        if problems.goals(problem)[0][0] > 1e-3:
            return problem


def test_one_contact_solution_equals_the_lcp():
    rng = np.random.default_rng(1)
    for _ in range(100):
        problem = pressed_alone(rng)
        status, V, forces = closed_form(problem)
        assert status == SOLVED
        assert_coulomb(problem, V, forces)
        assert np.allclose(motions(problem), V, atol=1e-9)
        N, T = problems.wrenches(problem)
        lcp_status, z = solve(*problems.lcp(problem))
        assert lcp_status == SOLVED
        assert np.allclose(problem.A @ (N[0] * z[0] + T[0] * (z[1] - z[2])), V, atol=1e-9)


@pytest.mark.parametrize(("contacts", "count"), [(2, 200), (3, 300)])
def test_two_and_three_contacts_are_solved_only_where_all_press(contacts, count):
    """The closed form returns a motion at which all contacts press; where there is none, it returns `RAY`.

    For three contacts it also returns `RAY` if such a motion needs a force above `LARGEST_FORCE`.
    """
    rng, outcomes = np.random.default_rng(2), []
    for k in range(count):
        problem = problems.random_contacts(rng, contacts)
        problem = problem._replace(mu=problem.mu * (contacts == 2 or k % 3 > 0))
        N, T = problems.wrenches(problem)
        normal, tangential = problems.goals(problem)
        all_motions = motions(problem)
        pressed = all_motions[np.abs(all_motions @ N.T - normal).max(axis=1, initial=0.0) < 1e-9]
        status, V, forces = closed_form(problem)
        outcomes.append(status == SOLVED)
        if status == SOLVED:
            assert_coulomb(problem, V, forces)
            assert np.abs(pressed - V).max(axis=1).min() < 1e-7
            continue
        assert status == RAY
        assert contacts == 3 or not len(pressed)
        for V in pressed:
            sense = np.sign(T @ V - tangential)[:, None]
            pressing = problem.A @ (N - sense * problem.mu[:, None] * T).T
            assert np.linalg.solve(pressing, V).max() > LARGEST_FORCE
    assert 0.01 < np.mean(outcomes) < 0.95


def test_solve_one_to_three_contacts_agrees_with_lemke():
    """Any motion that the solver returns is one of those that trying all contact modes gives.

    Where the solver returns `RAY` instead, so does Lemke's method.
    """
    rng = np.random.default_rng(3)
    for k in range(300):
        problem = problems.random_contacts(rng, 1 + k % 3)
        problem = problem._replace(gap=np.zeros(1 + k % 3))
        work = problems.posed(problem)
        status = solve_step(problem.mu[0], problem.mu[1] if k % 3 else 0.0, 1 + k % 3, work)
        all_motions = motions(problem)
        if status == SOLVED:
            assert np.abs(all_motions - work.V).max(axis=1).min() < 1e-6
        else:
            assert status == RAY
            assert solve(*problems.lcp(problem))[0] == RAY


def test_solve_flush_faces_hold_where_lemke_has_no_solution():
    """Overlapping faces hold the part whatever the friction; if the faces do not overlap, the part turns."""
    rng, verdicts = np.random.default_rng(5), list[int]()
    for _ in range(100):
        problem = problems.flush(rng)
        status = solve_step(problem.mu[0], problem.mu[1], 4, problems.posed(problem))
        lcp_status, z = solve(*problems.lcp(problem))
        held = lcp_status == RAY or z[:4].max() > UNBOUNDED
        assert (status == RAY) == held
        verdicts.append(status)
    assert 10 < np.sum(np.array(verdicts) == SOLVED) < 90


@pytest.mark.parametrize("bend", [-0.3, 0.0, 0.3])
def test_event_fraction_ends_where_an_open_contact_touches(bend):
    """In a step the motion is a parabola: it starts along the Euler step and ends as the midpoint step."""
    contacts = problems.rows(problems.receding())
    contacts[["gap", "un", "ut"]][0] = 0.2, 0.0, 0.0
    first, V = np.array([0.0, -1.0, 0.0]), np.array([0.0, -1.0 + bend, 0.0])
    f = event_fraction(contacts, 1, first, V)
    assert 0.0 < f < 1.0
    assert along(first, V, f, 1) == pytest.approx(-0.2, abs=1e-12)
    assert [along(first, V, 1.0, i) for i in range(3)] == pytest.approx(list(V))


@pytest.mark.parametrize("sense", [-1.0, 1.0])
def test_event_fraction_ends_where_a_pressed_contact_slides_off(sense):
    contacts = problems.rows(problems.receding())
    contacts[["gap", "un", "ut", "fn", "low", "high"]][0] = 0.0, 0.0, 0.0, 1.0, -0.3, 0.3
    first, V = np.array([sense, 0.0, 0.0]), np.array([0.8 * sense, 0.0, 0.0])
    f = event_fraction(contacts, 1, first, V)
    assert abs(along(first, V, f, 0)) == pytest.approx(0.3 + PAST_END_MM)


@pytest.mark.parametrize("mu", [0.1, 0.5])
def test_two_contacts_on_a_diagonal_hold_within_the_friction_angle(mu):
    limit = np.degrees(np.arctan(mu))
    assert closed_form(problems.jamming(limit - 0.01, mu))[0] == RAY
    status, V, forces = closed_form(problems.jamming(limit + 0.01, mu))
    assert status == SOLVED
    assert_coulomb(problems.jamming(limit + 0.01, mu), V, forces)
