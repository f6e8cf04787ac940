"""Whether a pose is within the goal, for each kind of goal."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sample_tables import changed, small_table

from planner.evaluation.judge import errors_mm, within_goal
from runtime.table import LeafPose, Tolerance

LEAF = 1  # of the small table, whose part has symmetry 2 and rho = 10.571 mm
PREDICTED = np.array([-1.2, -2.0, 1.571])  # pose of that leaf


def with_goal(**changes):
    table = small_table()
    return replace(table, goal=replace(table.goal, **changes))


def judge(table, pose):
    leaf = np.array([LEAF])
    within, error_mm = within_goal(table, leaf, pose), errors_mm(table, leaf, pose)
    return SimpleNamespace(within=within, error_mm=error_mm)


def verdict(table, *offset):
    return judge(table, PREDICTED + np.array([offset]))


def test_within_goal_pose_follows_equation_nine():
    table = small_table()
    assert verdict(table, 2.9, 0, 0).within.all()
    assert not verdict(table, 3.1, 0, 0).within.any()
    assert verdict(table, 1.0, 0, 1.9 / 10.571).within.all()
    assert not verdict(table, 1.0, 0, 2.1 / 10.571).within.any()
    assert verdict(table, 3.0, 4.0, 0.1).error_mm == pytest.approx(5.0 + 1.0571)


@pytest.mark.parametrize(
    ("offset", "within"),
    [
        ((2.4, 0.9, 0.08), True),
        ((2.6, 0, 0), False),
        ((0, 1.1, 0), False),
        ((0, 0, 0.09), False),
        ((2.4, -0.9, math.pi - 0.08), True),
    ],
    ids=["all inside", "x", "y", "angle", "half a turn"],
)
def test_within_goal_tolerances_bound_each_coordinate_alone(offset, within):
    table = with_goal(kind="tolerances", tolerance=Tolerance(2_500, 1_000, 87_266))
    assert verdict(table, *offset).within.all() == within


def test_within_goal_orientation_ignores_the_place():
    table = with_goal(kind="orientation", tolerance=Tolerance(0, 0, 87_266))
    assert verdict(table, 40.0, -40.0, 0.08).within.all()
    assert not verdict(table, 0, 0, 0.09).within.any()


def test_within_goal_modes_accepts_any_pose_of_the_leaf():
    far = LeafPose(9_000, 0, 0)
    leaf = small_table().leaves[LEAF]._replace(alternatives=(far,))
    table = changed(with_goal(kind="modes", modes=2), {f"leaves.{LEAF}": leaf})
    pose = np.array([[9.0, 1.0, 0.0]])
    assert judge(table, pose).error_mm == pytest.approx(1.0)
    assert judge(table, pose).within.all()
    assert not judge(table, pose + np.array([0, 5.0, 0])).within.any()
    only = replace(table, goal=replace(table.goal, kind="pose"))
    assert not judge(only, pose).within.any()
