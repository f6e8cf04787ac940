"""Algorithm 1 and its variants on a line, with models so simple that the results are known."""

import math

import numpy as np
import pytest
from counting import label_of
from problems import ENCODER

from planner.paper.search import (
    METHODS,
    Models,
    PaperPlanner,
    nearest_observation,
    singleton,
)
from planner.search.tree import breadth_first

HELD_MM, FREE_MM = 30.0, 10.0


def reach(poses, rng):
    """Parts within 3 mm of the hand move to it, the others stay; all scatter a little."""
    moved = poses + 0.02 * rng.standard_normal(poses.shape) * [1.0, 1.0, 0.0]
    moved[np.abs(poses[:, 0]) < 3.0, 0] = 0.0
    return moved


def widths(poses):
    return np.where(np.abs(poses[:, 0]) < 0.5, HELD_MM, FREE_MM)


def nowhere(poses):
    return np.zeros(len(poses), bool)


class Held:
    """A model with two subspaces, chosen by the width: held parts, which lie on y = 0, and free parts."""

    def label(self, widths_mm):
        return np.where(widths_mm > 20.0, 7, 4)

    def project(self, poses, label):
        projected = poses.copy()
        projected[label == 7, 1] = 0.0
        return projected


def planner(method):
    placements = np.array([[x, 0.0, 0.0] for x in (0.0, 3.0, 6.0, 9.0)])
    models = Models(reach, widths, nowhere, Held(), Held())
    return PaperPlanner(
        placements, models, ENCODER, lambda *_: -1.0, method, depth=2, max_depth=8, order=2
    )


def belief(n=600):
    rng = np.random.default_rng(2)
    return np.column_stack([rng.uniform(0, 10, n), rng.uniform(-0.1, 0.1, n), np.zeros(n)])


@pytest.fixture(scope="module")
def roots():
    return {method: planner(method).plan(belief(), [1]) for method in METHODS}


def leaves_of(root):
    return [node for node in breadth_first(root) if not node.children]


@pytest.mark.parametrize("method", METHODS)
def test_plan_conserves_particles_and_probability(roots, method):
    for node in breadth_first(roots[method]):
        if node.children:
            assert sum(child.share for child in node.children) == pytest.approx(node.share)
            assert sum(len(child.belief) for child in node.children) == len(node.belief)
            assert node.squeeze.clearance_mm >= 0.0
    assert sum(leaf.share for leaf in leaves_of(roots[method])) == pytest.approx(1.0)


def test_plan_sensorless_never_branches(roots):
    nodes = breadth_first(roots["sensorless"])
    assert all(len(node.children) == 1 for node in nodes[:-1])
    assert not nodes[-1].children
    assert [node.depth for node in nodes] == list(range(len(nodes)))
    assert len(nodes) > 2


@pytest.mark.parametrize("seed", range(10))
def test_nearest_observation_cells_cover_each_reading_once(seed):
    rng = np.random.default_rng(seed)
    subspace = rng.integers(0, 5, 300)
    centres = rng.uniform(0, 85, 5)
    width = np.clip(centres[subspace] + rng.normal(0, 0.5, 300), 0, 85)
    cells, child = nearest_observation(ENCODER, width, subspace)
    assert np.all(np.diff(cells.mean) < 0)
    assert np.array_equal(np.bincount(child), cells.size)
    assert cells.size.sum() == len(width)
    covered = [
        count
        for low, high in zip(cells.low, cells.high, strict=True)
        for count in range(low, high + 1)
    ]
    assert sorted(covered) == list(range(ENCODER.steps + 1))
    for count, label in zip(covered, label_of(cells, covered), strict=True):
        assert abs(count - cells.mean[label]) == np.abs(count - cells.mean).min()


def cloud(n, spread, centre=(0.0, 0.0, 0.0), seed=3):
    return np.random.default_rng(seed).normal(centre, spread, (n, 3))


@pytest.mark.parametrize("order", [1, 2, 3, 6])
def test_singleton_of_turned_cloud_is_its_mean_up_to_symmetry(order):
    poses = cloud(400, [0.3, 0.2, 0.02], [4.0, -7.0, 0.1])
    turns = np.random.default_rng(5).integers(0, order, 400) * math.tau / order
    seen = poses + np.column_stack([np.zeros((400, 2)), turns])
    assert singleton(seen, order).pose == pytest.approx(poses.mean(axis=0), abs=1e-3)
    assert singleton(seen, order).ratio == singleton(poses, order).ratio > 0.99


def test_singleton_of_order_two_takes_half_turns_as_equal():
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, math.pi]])
    assert singleton(poses, order=2).ratio == 1.0
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
def test_singleton_ratio_counts_poses_within_the_tolerances(offset, inside):
    reference = np.array([1.0, 2.0, 3.0])
    among = 10_000  # so many poses that one more does not move the average
    poses = np.concatenate([np.tile(reference, (among, 1)), reference[None] + offset])
    assert singleton(poses, order=2).ratio == (among + inside) / (among + 1)
