"""The cell's goal test against the planner's, for every kind of goal."""

import math

import numpy as np
import pytest
from sample_tables import small_table

from planner.belief.metric import Metric
from runtime.table import (
    Covariance,
    GoalSpec,
    Leaf,
    LeafPose,
    Tolerance,
    distance,
    error_mm,
    meets,
    poses_of,
    threshold,
)
from runtime.table.model import KINDS

TOLERANCE = (2.0, 1.0, 0.2)  # mm, mm, rad


def leaf_at(poses: np.ndarray) -> Leaf:
    first, *others = (
        LeafPose(*row) for row in (poses * [1e3, 1e3, 1e6]).round().astype(int).tolist()
    )
    exact = Covariance(0, 0, 0, 0, 0, 0)
    place = (first.x_um, first.y_um, first.theta_urad)
    return Leaf(*place, exact, 1_000_000, 1, True, tuple(others))


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "identity"])
def test_meets_equals_metric_of_planner(kind, order):
    rng = np.random.default_rng(order)
    metric = Metric(3.0, 10.0, order, kind, TOLERANCE, 2)
    goal = GoalSpec(3000, 950_000, 10_000, order, kind, Tolerance(2000, 1000, 200_000), 2)
    result = np.zeros(2, int)
    for _ in range(150):
        true = rng.uniform((-3, -2, -math.pi), (3, 2, math.pi))
        near = true + rng.normal(0.0, (1.5, 1.0, 0.15), (2, 3))
        turns = near[:, 2] + rng.integers(order) * 2 * math.pi / order
        near[:, 2] = np.remainder(turns + math.pi, 2 * math.pi) - math.pi
        leaf = leaf_at(near if kind == "modes" else near[:1])
        poses = np.array([pose[:3] for pose in leaf.poses]) / [1e3, 1e3, 1e6]
        wanted = bool(metric.reached(poses, true).any())
        assert meets(goal, leaf, tuple(true)) == wanted
        result[int(wanted)] += 1
        nearest = min(distance(goal, pose, tuple(true)) for pose in poses_of(goal, leaf))
        assert nearest == pytest.approx(metric.between(poses, true).min(), abs=1e-9)
        assert threshold(goal) == metric.goal
    assert (result > 12).all()


def test_error_mm_counts_angle_modulo_symmetry():
    goal = small_table().goal  # rho 10.571 mm, half turns are equal
    assert error_mm(goal, (0, 0, 0.1), (3, 4, 0.1)) == pytest.approx(5.0)
    assert error_mm(goal, (0, 0, 0.2), (0, 0, 0.1)) == pytest.approx(1.0571)
    assert error_mm(goal, (0, 0, 0.0), (0, 0, 3.14159265359)) == pytest.approx(0.0, abs=1e-9)
    assert error_mm(goal, (0, 0, 0.0), (0, 0, 1.5707963268)) == pytest.approx(16.605, abs=1e-3)
