"""Squeezes with ellipsoids and quartics as limit surfaces, parts that are released, and a fixed finger."""

import numpy as np
import pytest
from surfaces import hessian

from planner.arrays import take
from planner.belief.doubts import believed
from planner.belief.particles import initial
from planner.mechanics import quartic, surface
from planner.mechanics.simulator import Simulator
from planner.mechanics.surface_step import local_matrix


@pytest.fixture(scope="module")
def poses(job):
    return initial(job, 200, np.random.default_rng(5))


def test_local_matrix_is_a_third_of_the_hessian_and_gives_the_gradient(job):
    form = surface.of_job(job.replaced(pressure={"limit_surface": "quartic"}))
    assert isinstance(form, quartic.QuarticSurface)
    A = np.empty((3, 3))
    for F in np.random.default_rng(1).normal(size=(20, 3)):
        local_matrix(form.hessian_table(), F, A)
        np.testing.assert_allclose(A, hessian(form, F) / 3.0, atol=1e-12)
        np.testing.assert_allclose(A @ F, form.gradient(F), atol=1e-12)


def test_roll_out_of_mixed_surfaces_equals_each_part_alone(job, poses):
    doubting = job.replaced(pressure={"limit_surface": "any"}, doubt={"chance": 1.0})
    simulator, rng = Simulator.of_job(doubting, workers=1), np.random.default_rng(6)
    traits = believed(doubting, len(poses), rng).traits
    curved = traits["surface"] == 1
    assert curved.any()
    drawn = simulator.sample(len(poses), rng, traits)
    np.testing.assert_array_equal(drawn.ellipsoid, ~curved)
    rolled = simulator.roll_out(poses, drawn)
    for k in range(len(poses)):
        size, one = 6 if curved[k] else 3, take(drawn, np.array([k]))
        ours = one._replace(surfaces=one.surfaces[:, :size, :size].copy(), ellipsoid=None)
        alone = simulator.roll_out(poses[k : k + 1], ours)
        np.testing.assert_array_equal(alone.poses[0], rolled.poses[k])
        assert alone.width_mm[0] == rolled.width_mm[k]


def test_roll_out_quartic_of_ellipsoid_ends_as_the_ellipsoid(job, poses):
    plain = Simulator.of_job(job, workers=1)
    same = quartic.of_ellipsoid(plain.surface.A, plain.surface.rho_mm)
    both = np.zeros((len(poses), 6, 6))
    both[:, :3, :3] = plain.surface.A
    both[::2] = same.hessian_table()
    nominal = plain.nominal(len(poses), 0.5)
    mixed = nominal._replace(surfaces=both, ellipsoid=np.arange(len(poses)) % 2 == 1)
    a, b = plain.roll_out(poses, nominal), plain.roll_out(poses, mixed)
    np.testing.assert_allclose(b.poses, a.poses, atol=1e-5)
    np.testing.assert_array_equal(b.status, a.status)


def test_roll_out_release_moves_held_parts_only_and_as_stated(job, poses):
    released = job.replaced(release={"shift_mm": 0.5, "turn_deg": 2.0})
    simulator = Simulator.of_job(released, workers=1)
    far = np.concatenate([poses, poses + np.array([100.0, 0.0, 0.0])])
    drawn = simulator.sample(len(far), np.random.default_rng(4))
    still = simulator.roll_out(far, drawn._replace(release=np.zeros((len(far), 3))))
    moved = simulator.roll_out(far, drawn)
    offset = moved.poses - still.poses
    assert np.all(offset[len(poses) :] == 0.0)
    assert offset[: len(poses), :2].std() == pytest.approx(0.5, rel=0.2)
    assert offset[: len(poses), 2].std() == pytest.approx(np.radians(2.0), rel=0.2)


def test_roll_out_finger_share_of_zero_leaves_closing_to_the_other(job):
    uneven = job.replaced(gripper={"upper_finger_share": 0.0})
    simulator = Simulator.of_job(uneven, workers=1)
    rolled = simulator.roll_out(np.zeros((1, 3)), simulator.nominal(1, 0.5))
    # The lower finger pushes the part up to the upper one, which stands at half the opening.
    assert rolled.width_mm[0] == pytest.approx(21.0, abs=0.01)
    assert rolled.poses[0, 1] == pytest.approx(42.5 - 10.5, abs=0.01)
