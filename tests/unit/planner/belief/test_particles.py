"""Particles: how they are drawn; choosing, repeating and joining keeps the values of each together."""

import numpy as np
import pytest

from planner.belief.doubts import believed
from planner.belief.particles import Belief, evenly, initial, replenish, subsample
from planner.mechanics.traits import as_planned


@pytest.fixture(scope="module")
def belief(job):
    """A belief with traits, in which the reading of each particle is its number."""
    lying = believed(job, 300, np.random.default_rng(3))
    return Belief(lying.poses, lying.traits, np.arange(300))


def rows(belief):
    """Each particle as bytes."""
    columns = belief.poses, belief.traits, belief.reading
    return [b"".join(each.tobytes() for each in row) for row in zip(*columns, strict=True)]


@pytest.mark.parametrize(("draw", "off"), [(initial, 0.03), (evenly, 0.003)])
def test_initial_and_evenly_fill_disc_and_angles_uniformly(job, draw, off):
    narrow = job.replaced(uncertainty={"orientation_halfwidth_deg": 30.0})
    poses = draw(narrow, 4000, np.random.default_rng(1))
    radius, half = narrow.uncertainty.radius_mm, np.radians(30.0)
    bearing = np.arctan2(poses[:, 1], poses[:, 0])
    shares = [
        (np.hypot(*poses[:, :2].T) / radius) ** 2,  # rings of equal area
        0.5 + bearing / (2.0 * np.pi),
        0.5 + poses[:, 2] / (2.0 * half),
    ]
    for share in shares:
        quarters = np.histogram(share, 4, (0.0, 1.0))[0] / 4000
        np.testing.assert_allclose(quarters, 0.25, atol=off)


@pytest.mark.parametrize("n", [1, 70, 299, 300, 500])
def test_subsample_and_replenish_keep_particles_whole_and_spread_evenly(belief, n):
    whole = rows(belief)
    few, many = subsample(belief, n), replenish(belief, n)
    assert (len(few), len(many)) == (min(n, 300), max(n, 300))
    for other in (few, many):
        assert rows(other) == [whole[k] for k in other.reading]
    apart = np.diff(np.append(few.reading, 300))
    assert few.reading[0] == 0
    assert set(apart) <= {300 // len(few), -(-300 // len(few))}
    times = np.bincount(many.reading, minlength=300)
    assert times.max() - times.min() <= 1


def test_joined_pieces_of_a_belief_are_the_belief(belief):
    odd = belief.reading % 2 > 0
    pieces = [belief[:100], belief[np.arange(100, 200)], belief[np.arange(300) >= 200]]
    assert rows(Belief.joined(pieces)) == rows(belief)
    mixed = Belief.joined([belief[odd], belief[~odd]])
    assert rows(mixed) != rows(belief)
    assert sorted(rows(mixed)) == sorted(rows(belief))


def test_states_of_several_hypotheses_include_the_hypothesis(belief):
    traits = as_planned(4)
    assert Belief.of(belief.poses[:4], traits=traits).states.shape == (4, 3)
    traits["hypothesis"] = [0, 1, 0, 2]
    states = Belief.of(belief.poses[:4], traits=traits).states
    np.testing.assert_array_equal(states, np.column_stack([belief.poses[:4], [0, 1, 0, 2]]))
