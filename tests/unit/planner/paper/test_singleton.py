"""The singleton ratio as printed: averages under a symmetry, and the share near them."""

import math

import numpy as np
import pytest

from planner.paper.search import PRINTED_ORDER, TOLERANCES, singleton


def cloud(n, spread, centre=(0.0, 0.0, 0.0), seed=3):
    return np.random.default_rng(seed).normal(centre, spread, (n, 3))


def test_tolerances_are_the_papers():
    assert pytest.approx((2.5, 2.5, math.radians(5))) == TOLERANCES


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_average_of_a_tight_cloud_is_its_mean_whatever_turns_of_the_symmetry_it_is_seen_in(order):
    poses = cloud(400, [0.3, 0.2, 0.02], [4.0, -7.0, 0.1])
    turns = np.random.default_rng(5).integers(0, order, 400) * math.tau / order
    seen = poses + np.column_stack([np.zeros((400, 2)), turns])
    assert singleton(seen, order).pose == pytest.approx(poses.mean(axis=0), abs=1e-3)
    assert singleton(seen, order).ratio == singleton(poses, order).ratio > 0.99


def test_average_does_not_break_where_angles_wrap():
    theta = np.array(
        [math.pi / 2 - 0.01, -math.pi / 2 + 0.01]
    )  # half a turn apart: 0.02 for order 2
    poses = np.column_stack([np.zeros((2, 2)), theta])
    assert abs(singleton(poses, PRINTED_ORDER).pose[2]) == pytest.approx(math.pi / 2)
    assert singleton(poses, PRINTED_ORDER).ratio == 1.0


def test_printed_order_takes_a_half_turn_for_the_same_pose_also_where_it_is_not():
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi]])
    assert singleton(poses, PRINTED_ORDER).ratio == 1.0
    assert singleton(poses, order=1).ratio < 1.0


def test_two_modes_of_a_belief_average_to_neither():
    poses = np.concatenate(
        [cloud(500, [0.1, 0.1, 0.01], [6.0, 0, 0]), cloud(500, [0.1, 0.1, 0.01], [-6.0, 0, 0])]
    )
    mode = singleton(poses, PRINTED_ORDER)
    assert mode.ratio == 0.0
    assert mode.pose[0] == pytest.approx(0.0, abs=0.05)


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


def test_ratio_moves_with_the_belief():
    poses = cloud(1000, [2.0, 2.0, 0.05])
    moved = poses + np.array([30.0, -40.0, 1.0])
    assert singleton(moved, PRINTED_ORDER).ratio == pytest.approx(
        singleton(poses, PRINTED_ORDER).ratio, abs=0.003
    )
