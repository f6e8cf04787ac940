"""Distances between poses, the modes of a belief, and changes of frame."""

import numpy as np
import pytest

from planner.belief.metric import Metric, within
from planner.frames import to_hand, to_world, wrap


def metric(order=2):
    return Metric(distance_mm=3.0, rho_mm=10.0, order=order)


def test_between_equals_equation_nine_of_the_paper():
    distance = metric(1).between(np.array([3.0, 4.0, 0.1]), np.zeros(3))
    assert distance == pytest.approx(5.0 + 10.0 * 0.1)


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_between_pose_turned_by_the_symmetry_is_zero(order):
    pose = np.array([1.0, -2.0, 0.3])
    for k in range(order):
        turned = pose + np.array([0.0, 0.0, 2 * np.pi * k / order])
        assert metric(order).between(turned, pose) == pytest.approx(0.0, abs=1e-12)
    between = pose + np.array([0.0, 0.0, np.pi / order])
    assert metric(order).between(between, pose) == pytest.approx(10.0 * np.pi / order)


def test_between_is_symmetric_and_obeys_the_triangle_inequality():
    rng = np.random.default_rng(1)
    a, b, c = (rng.normal(size=(500, 3)) * [10, 10, 3] for _ in range(3))
    m = metric()
    np.testing.assert_allclose(m.between(a, b), m.between(b, a))
    assert np.all(m.between(a, c) <= m.between(a, b) + m.between(b, c) + 1e-9)


def test_mode_of_two_groups_is_in_the_larger_one():
    rng = np.random.default_rng(2)
    heavy = np.array([5.0, 0.0, 0.2]) + 0.1 * rng.standard_normal((700, 3)) * [1, 1, 0.05]
    light = np.array([-5.0, 3.0, 1.4]) + 0.1 * rng.standard_normal((300, 3)) * [1, 1, 0.05]
    belief = rng.permutation(np.concatenate([heavy, light]))
    mode = metric().mode(belief)
    assert mode.ratio == pytest.approx(0.7)
    assert metric().between(mode.pose, heavy.mean(axis=0)) < 0.05
    assert metric().reached(belief, belief.mean(axis=0)).mean() < 0.05


TOLERANCES = Metric(3.0, 10.0, 2, "tolerances", (2.0, 3.0, 0.2))
SEVERAL = Metric(3.0, 10.0, 2, further=((7.0, 1),))


@pytest.mark.parametrize("goal", [metric(), metric(6), TOLERANCES, SEVERAL])
def test_within_marks_the_states_that_reached_accepts(goal):
    rng = np.random.default_rng(6)
    states = rng.normal(size=(999, 3)) * [3.0, 3.0, 2.0]
    if goal.further:
        states = np.column_stack([states, rng.integers(0, 2, 999)])
    for centre in states[100:120]:
        inside = np.zeros(999, np.bool_)
        count = within(np.ascontiguousarray(states.T), 100, 900, centre, goal.weights(), inside)
        assert np.array_equal(inside[100:900], goal.reached(states[100:900], centre))
        assert count == inside.sum() > 0


def test_shares_equal_the_ratios_of_the_main_modes():
    rng = np.random.default_rng(9)
    beliefs = [rng.normal(size=(n, 4)) * [3.0, 3.0, 0.3, 1.0] for n in (1, 7, 200)]
    for states in beliefs:
        states[:, 3] = states[:, 3] > 0.0
    beliefs.append(beliefs[2][:, :3])  # of the first hypothesis alone
    m = metric()._replace(further=((8.0, 1),))
    for states, shares in zip(beliefs, m.shares(beliefs, 2), strict=True):
        results = [mode.ratio for mode in m.main_modes(states, 2)]
        np.testing.assert_allclose(shares, [*results, 0.0][:2])
    assert m.shares([], 2).shape == (0, 2)


PLACEMENT = np.array([3.0, -1.0, 0.7])


def test_to_world_inverts_to_hand():
    poses = np.random.default_rng(6).normal(size=(50, 3))
    np.testing.assert_allclose(to_world(to_hand(poses, PLACEMENT), PLACEMENT), poses, atol=1e-12)


def test_to_hand_pose_ahead_of_the_hand_lies_on_its_x_axis():
    along = np.array([[3.0 + 2 * np.cos(0.7), -1.0 + 2 * np.sin(0.7), 0.7]])
    np.testing.assert_allclose(to_hand(along, PLACEMENT), [[2.0, 0.0, 0.0]], atol=1e-12)


def test_wrap_keeps_the_angle_and_stays_within_half_a_period():
    angle = np.linspace(-20, 20, 1001)
    for order in (1, 2, 5):
        wrapped = wrap(angle, order)
        assert np.all(np.abs(wrapped) <= np.pi / order + 1e-12)
        turns = (angle - wrapped) / (2 * np.pi / order)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)


def test_mode_of_goal_with_several_modes_sums_their_shares():
    belief = np.repeat([[0.0, 0.0, 0.0], [9.0, 0.0, 1.0], [0.0, 9.0, 2.0]], [50, 30, 20], axis=0)
    ratios = [Metric(3.0, 10.0, 1, "modes", modes=m).mode(belief).ratio for m in (1, 2, 3)]
    assert ratios == pytest.approx([0.5, 0.8, 1.0])
    assert len(Metric(3.0, 10.0, 1, "modes", modes=3).mode(belief).others) == 2
