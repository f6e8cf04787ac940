"""Whether a leaf meets the goal, as the cell tells it: what the planner planned for, whatever the goal."""

import math

import numpy as np
import pytest

from planner.belief.metric import KINDS, Metric
from runtime.geometry import error_mm, meets
from runtime.table import GoalSpec, Leaf

TOLERANCE = (2.0, 1.0, 0.2)  # mm, mm, rad


def leaf_at(poses: np.ndarray) -> Leaf:
    first, *others = [(round(1000 * x), round(1000 * y), round(1e6 * turn)) for x, y, turn in poses]
    return Leaf(*first, (0, 0, 0, 0, 0, 0), 1_000_000, 1, True, tuple(others))


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("kind", KINDS)
def test_the_cell_and_the_planner_agree(kind: str, order: int) -> None:
    rng = np.random.default_rng(order)
    metric = Metric(3.0, 10.0, order, kind, TOLERANCE, 2)
    goal = GoalSpec(3000, 950_000, 10_000, order, kind, (2000, 1000, 200_000), 2)
    told = np.zeros(2, int)
    for _ in range(400):
        true = rng.uniform((-3, -2, -math.pi), (3, 2, math.pi))
        near = true + rng.normal(0.0, (1.5, 1.0, 0.15), (2, 3))
        near[:, 2] = (
            np.remainder(near[:, 2] + rng.integers(order) * 2 * math.pi / order + math.pi, 2 * math.pi)
            - math.pi
        )
        leaf = leaf_at(near if kind == "modes" else near[:1])
        poses = np.array([(leaf.x_um / 1e3, leaf.y_um / 1e3, leaf.theta_urad / 1e6), *leaf.alternatives])
        poses[1:] /= (1e3, 1e3, 1e6)
        wanted = bool(metric.reached(poses, true).any())
        assert meets(goal, leaf, tuple(true)) == wanted
        told[int(wanted)] += 1
        if kind in ("pose", "modes"):
            distance = error_mm(goal, leaf, tuple(true))
            assert distance == pytest.approx(metric.between(poses, true).min(), abs=1e-9)
    assert (told > 40).all()


def test_an_orientation_alone_has_no_distance() -> None:
    goal = GoalSpec(3000, 950_000, 10_000, 1, "orientation", (0, 0, 200_000), 1)
    assert error_mm(goal, leaf_at(np.zeros((1, 3))), (50.0, 0.0, 0.1)) is None
    assert meets(goal, leaf_at(np.zeros((1, 3))), (50.0, 0.0, 0.1))
