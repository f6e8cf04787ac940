"""Kinematics of the IRB 120: forward and inverse undo each other, and agree with the data sheet."""

import math
import random

import pytest

from drivers.abb import kinematics
from drivers.abb.codec import Pose
from drivers.abb.kinematics import compose, forward, inverse, invert


def apart(a, b):
    return math.dist(a[:3], b[:3]) + kinematics.turn_between(a.rotation, b.rotation)


def random_pose(rng):
    parts = [rng.gauss(0, 1) for _ in range(4)]
    length = math.hypot(*parts)
    return Pose(*(rng.uniform(-100, 100) for _ in range(3)), tuple(part / length for part in parts))


def test_forward_zero_joints_is_pose_of_data_sheet():
    home = forward((0.0,) * 6)
    assert home[:3] == pytest.approx((374.0, 0.0, 630.0))
    assert kinematics.rotate(home.rotation, (0.0, 0.0, 1.0)) == pytest.approx((1.0, 0.0, 0.0))


def test_inverse_is_none_beyond_reach_of_data_sheet():
    """The wrist centre is at most 580 mm from the shoulder; here, arm and hand point straight ahead."""
    ahead = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
    assert inverse(Pose(581.0 + 72.0, 0.0, 290.0, ahead)) is None
    target = Pose(579.0 + 72.0, 0.0, 290.0, ahead)
    assert apart(forward(inverse(target)), target) < 1e-6


def test_inverse_of_forward_gives_same_pose():
    rng, reached = random.Random(1), 0
    for _ in range(200):
        joints = tuple(rng.uniform(low, high) for low, high in kinematics.LIMITS_DEG)
        target = forward(joints)
        result = inverse(target)
        if result is not None:  # None: the elbow-up solution exceeds a limit
            reached += 1
            assert kinematics.within_limits(result)
            assert apart(forward(result), target) < 1e-6
    assert reached > 150


def test_inverse_hand_down_over_table_reaches_pose():
    rng = random.Random(2)
    for _ in range(200):
        turn = rng.uniform(-math.pi, math.pi)
        place = 300.0 + rng.uniform(-150, 150), rng.uniform(-150, 150), rng.uniform(5, 100)
        target = Pose(*place, (0.0, math.cos(turn / 2), math.sin(turn / 2), 0.0))
        assert apart(forward(inverse(target)), target) < 1e-6


def test_compose_is_associative_and_invert_undoes_it():
    rng = random.Random(3)
    for _ in range(200):
        a, b, c = (random_pose(rng) for _ in range(3))
        assert apart(compose(compose(a, b), c), compose(a, compose(b, c))) < 1e-6
        assert apart(compose(a, compose(invert(a), b)), b) < 1e-6
