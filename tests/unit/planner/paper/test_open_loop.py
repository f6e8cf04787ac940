"""The open-loop search on a line, where the best sequence can be found by trying all of them."""

import itertools
import math

import numpy as np
import pytest

from planner.paper.open_loop import ALPHA, OpenLoop
from planner.paper.search import singleton

RNG_SEED = 11


def wall(poses, _rng):
    """A wall at the hand, pushed against from its far side: x beyond it comes to lie on it."""
    moved = poses.copy()
    moved[:, 0] = np.minimum(moved[:, 0], 0.0)
    return moved


def beyond_reach(poses):
    """Collides with whatever lies further than 9.5 mm from the hand."""
    return np.hypot(poses[:, 0], poses[:, 1]) > 9.5


def ratio(poses):
    # Orientation plays no part on the line; the wall turned by half a turn pushes the other way.
    return singleton(poses, order=1, box=(1.0, 1e9, 10.0)).ratio


def line(low, high, n=401):
    return np.column_stack([np.linspace(low, high, n), np.zeros((n, 2))])


def left(x):
    """Pushes everything beyond x down to x."""
    return [x, 0.0, 0.0]


def right(x):
    """Pushes everything below x up to x."""
    return [x, 0.0, math.pi]


def search_of(placements, depth, **options):
    options = {"collides": lambda poses: np.zeros(len(poses), bool)} | options
    return OpenLoop(np.array(placements, float), wall, ratio=ratio, depth=depth, **options)


def best_by_trial(search, poses):
    """All sequences, shorter first, then by action: the first of the largest ratio among those not pruned."""
    result = ((), -np.inf)
    for length in range(1, search.depth + 1):
        for actions in itertools.product(range(len(search.placements)), repeat=length):
            belief, last, alive = poses, search.ratio(poses), True
            for action in actions:
                alive = alive and search.free(belief, search.placements[action])
                belief = search.moved(belief, search.placements[action], None)
                value = search.ratio(belief)
                alive = alive and value >= search.alpha * last
                last = value
            if alive and last > result[1]:
                result = (actions, last)
    return result


def found_by(search, poses):
    return search.search(poses, np.random.default_rng(RNG_SEED))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_search_finds_what_trying_everything_finds(seed, depth):
    rng = np.random.default_rng(seed)
    placements = [(left if rng.random() < 0.5 else right)(rng.uniform(0, 10)) for _ in range(4)]
    alpha = rng.choice([0.0, ALPHA, 0.95])
    search = search_of(placements, depth, collides=beyond_reach, alpha=alpha)
    best = found_by(search, line(0, 10))
    assert (best.actions, best.ratio) == best_by_trial(search, line(0, 10))


def test_of_equals_the_shortest_and_then_the_first_wins():
    search = search_of([left(9.0), left(1.0), left(1.0), right(0.0)], depth=3)
    assert found_by(search, line(0, 10)).actions == (1,)
