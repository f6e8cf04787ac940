"""The upper bound on the number of poses that one prediction can locate: it holds, and is nearly reached."""

import itertools

import numpy as np
import pytest

from planner.belief.metric import Metric
from planner.bound.cover import INFLATION, LEAST_SHARE, most_located

METRICS = [
    Metric(3.0, 10.6, 1),
    Metric(3.0, 10.6, 2),
    Metric(3.0, 10.6, 6),
    Metric(3.0, 0.2, 4),  # the whole turn is within the goal
    Metric(1.0, 10.6, 1, kind="tolerances", tolerance=(2.5, 1.0, np.radians(5.0))),
    Metric(1.0, 10.6, 2, kind="orientation", tolerance=(1.0, 1.0, np.radians(5.0))),
]
GRID = np.linspace(-2.0, 2.0, 9)
"""Predictions that `located` tries along each axis, in units of the goal about the group's middle."""


def group(rng, metric, n):
    """Random poses about a middle, a few of them farther off, each turned by a random number of periods.

    Returns:
        The poses (n, 3), the middle (3,), and the goal's size along each axis (3,).
    """
    unit = np.array([1.0 / w if w > 0.0 else 1.0 for w in metric.weights()[0, 1:4]])
    poses = rng.normal(size=(n, 3)) * unit * rng.uniform(0.1, 0.6)
    poses[: rng.integers(0, n // 4 + 1)] += unit * rng.uniform(-3.0, 3.0, 3)
    middle = rng.uniform(-9.0, 9.0, 3)
    poses += middle
    poses[:, 2] += 2.0 * np.pi / metric.order * rng.integers(-3, 4, n)
    return poses, middle, unit


def located(metric, poses, predictions, inflation=0.0):
    """Slow reference version: the largest number of poses that one of the `predictions` locates.

    `inflation` widens the goal by this share.
    """
    goal = metric.goal * (1.0 + inflation)
    return max(int((metric.between(poses, place) < goal).sum()) for place in predictions)


@pytest.mark.parametrize("metric", METRICS, ids=lambda m: f"{m.kind}-{m.order}-{m.rho_mm}")
def test_most_located_lies_between_a_grid_search_and_a_wider_goal(metric):
    rng = np.random.default_rng(1)
    for n in (1, 2, 3, 7, 40):
        poses, middle, unit = group(rng, metric, n)
        (most,) = most_located(poses, np.array([0, n]), metric.weights(), metric.order)
        grid = [middle + unit * np.array(steps) for steps in itertools.product(GRID, repeat=3)]
        result = located(metric, poses, [*grid, *poses])
        assert result <= most <= n
        # The goal about a grid point, wider by half a cell, holds all that a prediction in the cell locates.
        step = 0.5 * (GRID[1] - GRID[0]) * (np.sqrt(2.0) + 1.0)
        held = located(metric, poses, grid, step + INFLATION)
        assert most <= max(held, np.ceil(LEAST_SHARE * n) - 1)


def test_most_located_ring_is_whole_within_the_goal_and_not_beyond():
    metric = METRICS[1]
    for radius, all_located in ((2.99, True), (3.0 * (1.0 + INFLATION) + 0.01, False)):
        ring = [
            [radius * np.cos(b), radius * np.sin(b), np.pi * k]
            for k, b in enumerate(np.arange(0, 6, 0.2))
        ]
        (most,) = most_located(np.array(ring), np.array([0, 30]), metric.weights(), 2)
        assert (most == 30) == all_located
