"""The nearest leaf of a pose, and the reliability of the rates that leaves predict."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sample_tables import random_table

from planner.evaluation.judge import metric_of_table
from planner.evaluation.leaves import NO_LEAF, nearest_leaf, reliability
from runtime.table import PPM, poses_of


def test_nearest_leaf_is_the_nearest_within_the_goal_or_none():
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
    """A table whose leaves state success rates of `trials` trials each, and these leaves' true rates."""
    table = random_table(seed=15, nodes=60)
    truth = rng.beta(20.0, 0.5, len(table.leaves))
    hits = rng.binomial(trials, truth)
    rows = [
        leaf._replace(success_ppm=round(PPM * int(h) / trials), trials=trials)
        for leaf, h in zip(table.leaves, hits, strict=True)
    ]
    return replace(table, leaves=tuple(rows[:leaves])), truth[:leaves]


def observed(truth, rng, visits):
    """A stand-in for an evaluation: the fields that `reliability` reads, with random results."""
    leaf = np.repeat(np.arange(len(truth)), visits)
    return SimpleNamespace(leaf=leaf, within=rng.random(len(leaf)) < np.repeat(truth, visits))


@pytest.mark.parametrize(("trials", "visits"), [(300, 300), (2000, 250)])
def test_reliability_of_true_predictions_is_19_of_20_leaves(trials, visits):
    rng = np.random.default_rng(trials)
    shares = []
    for _ in range(5):
        table, truth = predicted_table(rng, 60, trials)
        shares.append(reliability(table, observed(truth, rng, visits)).share)
    assert np.mean(shares) >= 0.94
