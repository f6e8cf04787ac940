"""Right or wrong, by every kind of goal."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sample_tables import changed, small_table

from planner.evaluation.judge import errors_mm, within_goal
from runtime.table import LeafPose, Tolerance

LEAF = (
    1  # of the small table, at (-1.2, -2.0) mm and 1.571 rad; the part has order 2, rho = 10.571 mm
)
SAID = np.array([-1.2, -2.0, 1.571])


def with_goal(**changes):
    table = small_table()
    return replace(table, goal=replace(table.goal, **changes))


def judge(table, pose):
    leaf = np.array([LEAF])
    within, error_mm = within_goal(table, leaf, pose), errors_mm(table, leaf, pose)
    return SimpleNamespace(within=within, error_mm=error_mm)


def verdict(table, *offset):
    return judge(table, SAID + np.array([offset]))


def test_the_pose_goal_is_equation_9():
    table = small_table()
    assert verdict(table, 2.9, 0, 0).within.all()
    assert not verdict(table, 3.1, 0, 0).within.any()
    assert verdict(table, 1.0, 0, 1.9 / 10.571).within.all()
    assert not verdict(table, 1.0, 0, 2.1 / 10.571).within.any()
    assert verdict(table, 3.0, 4.0, 0.1).error_mm == pytest.approx(5.0 + 1.0571)


def test_tolerances_bound_each_coordinate_alone():
    table = with_goal(kind="tolerances", tolerance=Tolerance(2_500, 1_000, 87_266))
    for offset, expected in [
        ((2.4, 0.9, 0.08), True),
        ((2.6, 0, 0), False),
        ((0, 1.1, 0), False),
        ((0, 0, 0.09), False),
        ((2.4, -0.9, math.pi - 0.08), True),
    ]:
        assert verdict(table, *offset).within.all() == expected


def test_orientation_alone_forgets_the_place():
    table = with_goal(kind="orientation", tolerance=Tolerance(0, 0, 87_266))
    assert verdict(table, 40.0, -40.0, 0.08).within.all()
    assert not verdict(table, 0, 0, 0.09).within.any()


def test_any_of_a_leafs_modes_will_do():
    far = LeafPose(9_000, 0, 0)
    leaf = small_table().leaves[LEAF]._replace(alternatives=(far,))
    table = changed(with_goal(kind="modes", modes=2), {f"leaves.{LEAF}": leaf})
    pose = np.array([[9.0, 1.0, 0.0]])
    assert judge(table, pose).error_mm == pytest.approx(1.0)
    assert judge(table, pose).within.all()
    assert not judge(table, pose + np.array([0, 5.0, 0])).within.any()
    only = replace(table, goal=replace(table.goal, kind="pose"))
    assert not judge(only, pose).within.any()
