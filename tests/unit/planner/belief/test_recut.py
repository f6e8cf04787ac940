"""Branches are split where the next squeeze shows that this pays."""

import numpy as np
import pytest

from planner.belief.metric import Metric
from planner.belief.observation import Resolution
from planner.belief.particles import Belief
from planner.belief.partition import Rule
from planner.belief.recut import recut
from planner.belief.stopping import StoppingRule

RULE = Rule(Metric(3.0, 10.0, 2), StoppingRule(0.95), Resolution(free=228))


def lost(n):
    """n poses so far apart that no goal holds two of them."""
    return np.column_stack([np.arange(n) * 20.0, np.zeros(n), np.zeros(n)])


@pytest.mark.parametrize(
    ("gap", "poses", "reads", "cuts"),
    [
        (10, 2, [150, 150], [110]),
        (10, 1, [150, 150], []),
        (10, 2, [150, 180], []),
        (3, 2, [150, 150], [103]),
        (2, 2, [150, 150], []),
    ],
    ids=[
        "two poses read alike after the squeeze",
        "one pose",
        "the squeeze distinguishes two poses",
        "least gap",
        "parts would stray into a leaf of another pose",
    ],
)
def test_recut_cuts_where_the_next_squeeze_does_not_distinguish(gap, poses, reads, cuts):
    old = Belief.of(lost(700), np.repeat([100, 100 + gap], [500, 200]))
    there = np.repeat(lost(2)[[0, poses - 1]], [500, 200], axis=0)
    new = Belief.of(there, np.repeat(reads, [500, 200]))
    assert recut(old, new, RULE).tolist() == cuts


def test_recut_leaf_into_which_other_poses_stray_is_not_cut():
    """A cut would make a leaf of the parts that read 100, since all of them lie at one pose.

    Parts at other poses read 102. This is so near that in the cell such parts may read 100 and end at this
    leaf. Without a cut, the next squeeze distinguishes the two groups.
    """
    poses = np.concatenate([np.tile([0.0, 90.0, 0.0], (500, 1)), lost(500)])
    old = Belief.of(poses, np.repeat([100, 102], 500))
    new = Belief.of(np.repeat(lost(2), 500, axis=0), np.repeat([150, 180], 500))
    assert len(recut(old, new, RULE)) == 0


def test_recut_permuted_particles_gives_the_same_cuts():
    old = Belief.of(lost(700), np.repeat([100, 110, 120], [400, 200, 100]))
    rng = np.random.default_rng(4)
    read, mixed = rng.choice([150, 180], 700), rng.permutation(700)
    new = Belief.of(np.repeat(lost(3), [400, 200, 100], axis=0), read)
    cuts = recut(old, new, RULE).tolist()
    assert cuts == [110, 120]
    assert recut(old[mixed], new[mixed], RULE).tolist() == cuts
