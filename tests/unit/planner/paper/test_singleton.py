"""The singleton ratio as printed: averages under a symmetry, and the share near them."""

import math

import numpy as np
import pytest

from planner.paper.search import PRINTED_ORDER, singleton


def cloud(n, spread, centre=(0.0, 0.0, 0.0), seed=3):
    return np.random.default_rng(seed).normal(centre, spread, (n, 3))


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_average_of_a_tight_cloud_is_its_mean_whatever_turns_of_the_symmetry_it_is_seen_in(order):
    poses = cloud(400, [0.3, 0.2, 0.02], [4.0, -7.0, 0.1])
    turns = np.random.default_rng(5).integers(0, order, 400) * math.tau / order
    seen = poses + np.column_stack([np.zeros((400, 2)), turns])
    assert singleton(seen, order).pose == pytest.approx(poses.mean(axis=0), abs=1e-3)
    assert singleton(seen, order).ratio == singleton(poses, order).ratio > 0.99


def test_printed_order_takes_a_half_turn_for_the_same_pose_also_where_it_is_not():
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi]])
    assert singleton(poses, PRINTED_ORDER).ratio == 1.0
    assert singleton(poses, order=1).ratio < 1.0


@pytest.mark.parametrize(
    ("offset", "inside"),
    [
        ((2.49, 2.49, math.radians(4.99)), True),
        ((2.51, 0, 0), False),
        ((0, -2.51, 0), False),
        ((0, 0, math.radians(5.01)), False),
        ((0, 0, math.pi + math.radians(4.99)), True),
    ],
)
def test_the_box_is_the_tolerances(offset, inside):
    reference = np.array([1.0, 2.0, 3.0])
    among = 10_000  # so many that one more does not move the average
    poses = np.concatenate([np.tile(reference, (among, 1)), reference[None] + offset])
    assert singleton(poses, PRINTED_ORDER).ratio == (among + inside) / (among + 1)
