"""The open-loop search on a line, where all sequences can be tried."""

import itertools
import math

import numpy as np
import pytest

from planner.paper import open_loop
from planner.paper.open_loop import ALPHA, OpenLoop

RNG_SEED = 11


def wall(poses, _rng):
    """A squeeze that acts as a wall at the hand: parts at x > 0 move to x = 0."""
    moved = poses.copy()
    moved[:, 0] = np.minimum(moved[:, 0], 0.0)
    return moved


def beyond_reach(poses):
    """Mask of the poses with which the hand collides: those more than 9.5 mm away from it."""
    return np.hypot(poses[:, 0], poses[:, 1]) > 9.5


def ratio(poses):
    """Share of poses whose x is within 1 mm of the mean x; orientation plays no part."""
    return np.mean(np.abs(poses[:, 0] - poses[:, 0].mean()) <= 1.0)


def line(low, high, n=401):
    return np.column_stack([np.linspace(low, high, n), np.zeros((n, 2))])


def left(x):
    """A placement of the hand that moves all parts beyond x down to x."""
    return [x, 0.0, 0.0]


def right(x):
    """A placement of the hand that moves all parts below x up to x."""
    return [x, 0.0, math.pi]


def nowhere(poses):
    return np.zeros(len(poses), bool)


def search_of(placements, depth, collides=nowhere):
    return OpenLoop(np.array(placements, float), wall, collides, ratio, depth)


def best_by_trial(search, poses):
    """Slow reference version: tries all sequences; returns the best one that is not pruned, and its ratio.

    Of equally good sequences it returns the first; shorter ones are tried first.
    """
    result = ((), -np.inf)
    for length in range(1, search.depth + 1):
        for actions in itertools.product(range(len(search.placements)), repeat=length):
            belief, last, alive = poses, search.ratio(poses), True
            for action in actions:
                alive = alive and search.free(belief, search.placements[action])
                belief = search.moved(belief, search.placements[action], None)
                value = search.ratio(belief)
                alive = alive and value >= open_loop.ALPHA * last
                last = value
            if alive and last > result[1]:
                result = (actions, last)
    return result


def searched(search, poses):
    return search.search(poses, np.random.default_rng(RNG_SEED))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_search_equals_the_best_of_all_sequences(seed, depth, monkeypatch):
    rng = np.random.default_rng(seed)
    placements = [(left if rng.random() < 0.5 else right)(rng.uniform(0, 10)) for _ in range(4)]
    monkeypatch.setattr(open_loop, "ALPHA", rng.choice([0.0, ALPHA, 0.95]))
    search = search_of(placements, depth, beyond_reach)
    best = searched(search, line(0, 10))
    assert (best.actions, best.ratio) == best_by_trial(search, line(0, 10))


def test_search_equal_ratios_prefers_the_shortest_then_the_first():
    search = search_of([left(9.0), left(1.0), left(1.0), right(0.0)], depth=3)
    assert searched(search, line(0, 10)).actions == (1,)
