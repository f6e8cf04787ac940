"""The kernel density estimate agrees with a slow reference version, and is exact for untouched parts."""

import math
from typing import NamedTuple

import kcde_twin
import numpy as np
import pytest
from problems import JAWS, LONG_JAWS, random_poses, rectangle, simulator
from scipy import stats

from planner.learned.kcde import NEIGHBOURS, Kcde
from planner.learned.neighbours import grid_of, nearest_within, within
from planner.mechanics.clearance import MISSES, STANDS_ON, TOUCHES, classify_contact

pytestmark = pytest.mark.slow
RHO = 10.57


class Rolled(NamedTuple):
    initial: np.ndarray
    final: np.ndarray
    width_mm: np.ndarray


def random_outcomes(n, seed, radius=8.0):
    """Random initial poses, final poses and widths, which no mechanics connects."""
    rng = np.random.default_rng(seed)
    return Rolled(random_poses(rng, n, radius), random_poses(rng, n, 5.0), rng.uniform(20, 40, n))


def fitted(rolled, order=2):
    """A density estimate from outcomes, for fingers so long that they touch every part."""
    return Kcde.fit(rolled, rectangle(), LONG_JAWS, RHO, order)


@pytest.mark.parametrize("n", [1, 2, 37, 1500])
@pytest.mark.parametrize("reach", [0.3, 2.0, 40.0])
def test_within_and_nearest_within_equal_a_linear_scan(n, reach):
    rng = np.random.default_rng(n)
    period = 20.0
    points = rng.uniform([-10, -10, -30], [10, 10, 30], (n, 3))
    grid = grid_of(points, period)
    place, squares = np.empty(n + 1, np.int64), np.empty(n + 1)
    for q in rng.uniform([-14, -14, 0], [14, 14, period], (40, 3)):
        gap = points - q
        gap[:, 2] -= period * np.round(gap[:, 2] / period)
        square = (gap**2).sum(axis=1)
        result = within(grid, q, reach, place, squares)
        assert sorted(grid.row[place[:result]]) == np.flatnonzero(square <= reach**2).tolist()
        result = nearest_within(grid, q, reach, 1.5, place, squares)
        near = np.flatnonzero(square <= square.min() + 1.5)
        assert sorted(grid.row[place[:result]]) == near.tolist()
        assert np.allclose(np.sort(squares[:result]), np.sort(square[near] - square.min()))


@pytest.mark.parametrize("order", [1, 2, 6])
def test_sample_follows_the_exact_mixture(order):
    rolled = random_outcomes(4000, 1)
    model = fitted(rolled, order)
    rng = np.random.default_rng(2)
    for pose in [*random_poses(rng, 4, 8.0), np.array([30.0, 3.0, 0.0])]:
        n = 20_000
        drawn = model.sample(np.repeat(pose[None], n, axis=0), rng)
        expected = n * kcde_twin.weights(pose[None], rolled.initial, RHO, order, 0.5)[0]
        counts = np.bincount(drawn.source, minlength=4000)
        common = expected > 5
        counts = np.append(counts[common], counts[~common].sum())
        expected = np.append(expected[common], expected[~common].sum())
        assert stats.chisquare(counts[expected > 0], expected[expected > 0]).pvalue > 1e-4
        end = rolled.final[drawn.source]
        residual = drawn.poses - end
        period = math.tau / order
        residual[:, 2] = RHO * (residual[:, 2] - period * np.round(residual[:, 2] / period))
        for column in residual.T:
            assert stats.kstest(column / 0.5, "norm").pvalue > 1e-4
        assert np.array_equal(drawn.width_mm, rolled.width_mm[drawn.source])


def test_sample_draws_from_the_nearest_roll_outs_only():
    initial = np.zeros((1001, 3))
    initial[1000, 0] = 0.5  # as far as a bandwidth, behind a thousand others
    rolled = Rolled(initial, np.zeros((1001, 3)), np.full(1001, 21.0))
    drawn = fitted(rolled).sample(np.zeros((20_000, 3)), np.random.default_rng(5))
    assert not np.any(drawn.source == 1000)
    assert len(np.unique(drawn.source)) == NEIGHBOURS


def test_sample_untouched_parts_stay_exactly():
    part = simulator(rectangle())
    rng = np.random.default_rng(6)
    start = random_poses(rng, 3000, 38.0)
    rolled = part.roll_out(start, part.sample(3000, rng))
    rolled = Rolled(start, rolled.poses, rolled.width_mm)
    model = Kcde.fit(rolled, part.outline, JAWS, part.surface.rho_mm, order=2)
    poses = random_poses(rng, 3000, 60.0)
    before = poses.copy()
    drawn = model.sample(poses, rng)
    direct = part.roll_out(poses, part.sample(3000, rng))
    verdict = classify_contact(part.outline, JAWS, poses)
    still = verdict != TOUCHES
    assert np.array_equal(poses, before)
    assert np.array_equal(drawn.poses[still], poses[still])
    assert np.array_equal(direct.poses[still], poses[still])
    assert np.array_equal(drawn.width_mm[still], direct.width_mm[still])
    assert np.all((drawn.source < 0) == still)
    assert np.array_equal(verdict == MISSES, direct.status == 0)
    assert np.all(direct.width_mm[verdict == STANDS_ON] == JAWS.opening_mm)
    assert np.any(verdict == MISSES)
    assert np.any(verdict == STANDS_ON)


def test_sample_pose_turned_by_the_symmetry_ends_turned():
    model = fitted(random_outcomes(3000, 11), order=3)
    poses = random_poses(np.random.default_rng(12), 500, 8.0)
    turned = poses + np.array([0.0, 0.0, math.tau / 3])
    ours = model.sample(poses, np.random.default_rng(13))
    theirs = model.sample(turned, np.random.default_rng(13))
    assert np.array_equal(ours.source, theirs.source)
    assert np.allclose(theirs.poses - ours.poses, [0.0, 0.0, math.tau / 3], atol=1e-9)
