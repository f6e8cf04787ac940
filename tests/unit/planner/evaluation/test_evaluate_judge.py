"""Right or wrong, by every kind of goal; and what is made of the mistakes."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sample_tables import changed, random_table, small_table

from planner.evaluation.judge import errors_mm, metric_of_table, within_goal
from planner.evaluation.leaves import NO_LEAF, nearest_leaf, reliability
from planner.evaluation.outcome import CRASHED, NOWHERE, REJECTED, Evaluation
from planner.mechanics.traits import as_planned
from runtime.table import PPM, LeafPose, Tolerance, poses_of

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


def test_what_ends_at_no_leaf_claims_nothing_however_few_leaves_there_are():
    table = small_table()
    for leaves in (table.leaves[:1], table.leaves):
        few = replace(table, leaves=leaves)
        ends = np.array([CRASHED, REJECTED, NOWHERE, 0])
        poses, taken = np.zeros((4, 3)), np.full((4, 1), NOWHERE)
        run = Evaluation(few, ends, np.zeros(4), poses, poses, as_planned(4), taken, taken, taken)
        assert list(run.resolved) == [False, False, False, True]


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


def test_the_true_leaf_is_the_nearest_one_within_the_goal():
    table = random_table(seed=12, nodes=8)
    rng = np.random.default_rng(2)
    poses = rng.uniform([-14, -14, -3], [14, 14, 3], (200, 3))
    metric = metric_of_table(table)
    for pose, result in zip(poses, nearest_leaf(table, poses), strict=True):
        distances = [
            float(metric.between(pose, np.array(poses_of(table.goal, leaf)[0])))
            for leaf in table.leaves
        ]
        if result == NO_LEAF:
            assert min(distances) >= metric.distance_mm
        else:
            assert distances[result] == min(distances) < metric.distance_mm


def predicted_table(rng, leaves, trials):
    """A table with honest predictions, from that many trials of each leaf; and the truth behind it."""
    table = random_table(seed=15, nodes=60)
    truth = rng.beta(20.0, 0.5, len(table.leaves))
    hits = rng.binomial(trials, truth)
    rows = [
        leaf._replace(success_ppm=round(PPM * int(h) / trials), trials=trials)
        for leaf, h in zip(table.leaves, hits, strict=True)
    ]
    return replace(table, leaves=tuple(rows[:leaves])), truth[:leaves]


def observed(truth, rng, visits):
    """What `reliability` reads of an evaluation: leaves, and which of their parts were within the goal."""
    leaf = np.repeat(np.arange(len(truth)), visits)
    return SimpleNamespace(leaf=leaf, within=rng.random(len(leaf)) < np.repeat(truth, visits))


@pytest.mark.parametrize(("trials", "visits"), [(300, 300), (2000, 250)])
def test_honest_predictions_hold_in_19_of_20_leaves(trials, visits):
    rng = np.random.default_rng(trials)
    shares = []
    for _ in range(5):
        table, truth = predicted_table(rng, 60, trials)
        shares.append(reliability(table, observed(truth, rng, visits)).share)
    assert np.mean(shares) >= 0.94
