"""The energy distance against its twin and known values."""

import math

import kcde_twin
import numpy as np
import pytest
from energy import energy_distance
from problems import random_poses

RHO = 10.57


@pytest.mark.parametrize("order", [1, 2, 5])
@pytest.mark.parametrize(("n", "m"), [(1, 1), (3, 200), (150, 80)])
def test_every_pair_counts(order, n, m):
    rng = np.random.default_rng(n)
    a, b = random_poses(rng, n, 10.0), random_poses(rng, m, 12.0)
    twin = kcde_twin.energy_distance(a, b, RHO, order)
    assert energy_distance(a, b, RHO, order) == pytest.approx(twin)
    assert energy_distance(b, a, RHO, order) == pytest.approx(twin)


def test_known_values():
    here, there = np.zeros((5, 3)), np.tile([3.0, 4.0, 0.0], (7, 1))
    assert energy_distance(here, there, RHO) == pytest.approx(10.0)
    assert energy_distance(here, here, RHO) == 0.0
    turned = np.tile([0.0, 0.0, math.pi], (4, 1))
    assert energy_distance(here, turned, RHO, 1) == pytest.approx(4 * RHO)
    assert energy_distance(here, turned, RHO, 2) == pytest.approx(0.0, abs=1e-9)


def test_small_turns_weigh_rho():
    here, turned = np.zeros((2, 3)), np.tile([0.0, 0.0, 1e-3], (2, 1))
    for order in (1, 2, 3):
        assert energy_distance(here, turned, RHO, order) == pytest.approx(2e-3 * RHO, rel=1e-5)


def test_one_sample_in_two_halves_is_as_far_apart_as_theory_says():
    rng = np.random.default_rng(0)
    n, spread = 400, []
    for _ in range(40):
        poses = random_poses(rng, 2 * n, 10.0)
        spread.append(energy_distance(poses[:n], poses[n:], RHO))
    a, b = random_poses(rng, 4000, 10.0), random_poses(rng, 4000, 10.0)
    points = [
        np.column_stack([p[:, :2], RHO * np.cos(p[:, 2]), RHO * np.sin(p[:, 2])]) for p in (a, b)
    ]
    expected = 2.0 / n * np.linalg.norm(points[0] - points[1], axis=1).mean()
    assert np.mean(spread) == pytest.approx(expected, rel=0.1)
