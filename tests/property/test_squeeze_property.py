"""Random simple polygons, friction and poses: the result of every squeeze is physically possible."""

import numpy as np
import pytest
from contact_problems import goals, posed, random_contacts, wrenches
from hypothesis import given, settings
from hypothesis import strategies as st
from problems import JAWS, deepest_overlap, random_convex, random_poses, random_star, simulator

from planner.mechanics.simulator import STATUS_NAMES
from planner.mechanics.step import SOLVED, solve

CASES = settings(max_examples=30, derandomize=True)
PENETRATION_MM = 0.02
seeds = st.integers(0, 10**6)
frictions = st.floats(0.0, 1.0)


def compact(seed):
    """A convex part, or a star whose points are too short to reach around a finger."""
    rng = np.random.default_rng(seed)
    if seed % 2:
        return random_convex(rng, 4 + seed % 7)
    return random_star(rng, 3 + seed % 13, smallest=9.0, largest=15.0)


def spiky(seed):
    """A star with points up to 24 mm long: some reach behind the fingers."""
    return random_star(np.random.default_rng(seed), 3 + seed % 13)


def squeezed(outline, seed, mu, count=25):
    """Initial poses and the result of squeezing them; each squeeze has another limit surface."""
    rng = np.random.default_rng(seed + 1)
    part = simulator(outline)
    poses = random_poses(rng, count, 30.0)
    sampled = part.sample(count, rng)
    return poses, part.roll_out(poses, sampled._replace(mu=np.full((count, 2), mu)))


@pytest.mark.parametrize("shape", [compact, spiky])
@CASES
@given(seed=seeds, mu=frictions)
def test_roll_out_fingers_do_not_overlap_part(shape, seed, mu):
    outline = shape(seed)
    poses, result = squeezed(outline, seed, mu)
    for before, pose, width in zip(poses, result.poses, result.width_mm, strict=True):
        if deepest_overlap(outline, before, JAWS.opening_mm) == 0.0:
            assert deepest_overlap(outline, pose, width) <= PENETRATION_MM


@CASES
@given(seed=seeds, mu=frictions)
def test_roll_out_result_is_finite_and_fits_its_status(seed, mu):
    outline = spiky(seed)
    poses, result = squeezed(outline, seed, mu)
    assert np.isfinite(result.poses).all()
    assert ((result.width_mm >= 0.0) & (result.width_mm <= JAWS.opening_mm)).all()
    names = np.array(STATUS_NAMES)[result.status]
    free = np.isin(names, ["untouched", "slipped"])
    assert np.array_equal(result.width_mm == 0.0, free)
    untouched = names == "untouched"
    assert np.array_equal(result.poses[untouched], poses[untouched])
    assert np.isin(result.given_up, [0, 1]).all()


@CASES
@given(seed=seeds, mu=frictions)
def test_roll_out_moves_part_no_farther_than_fingers(seed, mu):
    """Along the closing axis, a part's distance from the hand grows by at most the way of one finger."""
    outline = compact(seed)
    poses, result = squeezed(outline, seed, mu)
    closed = 0.5 * (JAWS.opening_mm - result.width_mm)
    assert (np.abs(result.poses[:, 1]) <= np.abs(poses[:, 1]) + closed + 1e-6).all()


@CASES
@given(seed=seeds, contacts=st.integers(1, 4))
def test_solve_dissipation_is_not_negative(seed, contacts):
    """The table and each finger dissipate at least zero, together at most the work of the fingers."""
    for k in range(20):
        problem = random_contacts(np.random.default_rng([seed, k]), contacts)
        problem = problem._replace(gap=np.zeros(contacts))
        work, mu_bottom = posed(problem), problem.mu[1] if contacts > 1 else 0.0
        if solve(problem.mu[0], mu_bottom, contacts, work) != SOLVED:
            continue
        V, fn, ft = work.V, work.contacts["fn"][:contacts], work.contacts["ft"][:contacts]
        N, T = wrenches(problem)
        normal, tangential = goals(problem)
        on_table = V @ (N.T @ fn + T.T @ ft)
        at_fingers = -ft * (T @ V - tangential)
        put_in = fn @ normal + ft @ tangential
        rounding = 1e-10 * (1.0 + fn.max())  # a slip is solved to 1e-10 mm, whatever the force
        assert on_table >= 0.0
        assert at_fingers.min() >= -rounding
        assert put_in >= on_table + at_fingers.sum() - rounding
