"""Projection onto subspaces gives the nearest pose, as by brute force; repeating it changes nothing."""

import math

import numpy as np
import pytest
from problems import ENCODER, rectangle, rolled

from planner.frames import wrap
from planner.mechanics.quartic_fit import fit_pressure
from planner.paper.projection import Projection
from planner.paper.subspaces import subspaces_of
from planner.part.outline import radius_of_gyration
from planner.part.pressure import Pressure, support

OUTLINE = rectangle()
RHO = radius_of_gyration(OUTLINE)


@pytest.fixture(scope="module", params=["ellipsoid", "quartic"])
def case(request):
    """Final poses of squeezes, the label of each pose's subspace, and a projection learned from both."""
    quartic = request.param == "quartic"
    load = support(Pressure("boundary", 100), OUTLINE)
    surface = fit_pressure(*load, RHO) if quartic else None
    ends = rolled(OUTLINE, 9000, 38.25, seed=5, surface=surface)
    label = subspaces_of(ends.width_mm, ENCODER).label(ends.width_mm)
    return ends.poses, label, Projection.fit(ends.poses, label, RHO, 2)


def shaken(poses):
    return poses + 0.8 * np.random.default_rng(0).standard_normal(poses.shape) / [1.0, 1.0, RHO]


def distance(a, b):
    turn = wrap(a[..., 2] - b[..., 2], 2)
    return np.sqrt((a[..., 0] - b[..., 0]) ** 2 + (a[..., 1] - b[..., 1]) ** 2 + (RHO * turn) ** 2)


def test_project_moves_to_the_nearest_pose_of_the_subspace(case):
    ends, label, projection = case
    particles, asked = shaken(ends[:400]), label[:400]
    projected = projection.project(particles, asked)
    for pose, k, end in zip(particles, asked, projected, strict=True):
        if k == 0:
            assert np.array_equal(end, pose)
            continue
        every = distance(pose, ends[label == k])
        assert distance(pose, end) == pytest.approx(every.min(), abs=1e-9)
        assert distance(end, ends[label == k]).min() < 1e-9


def test_project_twice_equals_once(case):
    ends, label, projection = case
    once = projection.project(shaken(ends), label)
    twice = projection.project(once, label)
    assert np.array_equal(twice, once)


def test_project_pose_at_the_angle_seam_reaches_across_it():
    stored = np.array([[0.0, 0.0, math.pi - 1e-3], [0.0, 0.0, 1.5]])
    projection = Projection.fit(stored, np.ones(2, np.int64), RHO, 2)
    for angle in (1e-3, -1e-17, 0.0, math.pi, 7 * math.pi):
        projected = projection.project(np.array([[0.0, 0.0, angle]]), np.ones(1, np.int64))
        assert distance(np.array([0.0, 0.0, angle]), projected)[0] < 3e-3 * RHO
        assert abs(projected[0, 2] - angle) < 3e-3


@pytest.mark.parametrize("order", [1, 2, 3, 5, 6])
def test_project_angle_just_below_a_period_returns_its_pose(order):
    period = math.tau / order
    below = [np.nextafter(period, 0.0), period, -1e-300, np.nextafter(-period, 0.0), 3.0 * period]
    poses = np.array([[float(k), 0.0, angle] for k, angle in enumerate(below)])
    for rho in np.random.default_rng(order).uniform(5.0, 20.0, 300):
        stored = Projection.fit(poses, np.ones(len(poses), np.int64), rho, order)
        result = stored.project(poses + np.array([0.1, 0.0, 0.0]), np.ones(len(poses), np.int64))
        assert np.array_equal(result[:, :2], poses[:, :2])
        assert np.allclose(wrap(result[:, 2] - poses[:, 2], order), 0.0, atol=1e-12)
