"""Hasty trees: which squeeze costs least, told in a fraction of the time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import BELIEF, SILENT, TELLING, Oracle, look_ahead

from planner.job import model as job_file
from planner.search.actions import Action
from planner.search.expand import Growth, TreeNode, breadth_first, untold
from planner.search.handling import handling_of
from planner.search.hasty import costs, grow_hastily, squeeze_first
from planner.search.params import SearchParams

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"
SIDEWAYS = 20.0  # mm along the fingers from the middle


def in_time():
    return False


def placed(angle, x=0.0):
    return np.array([x, 0.0, angle])


@pytest.fixture
def growth():
    return Growth(look_ahead([SILENT, TELLING]), Oracle(), handling_of(job_file.load(RECTANGLE)), 4)


def with_first(growth, placements):
    """The same with placements of the first squeeze's own, of parts that lie at any angle."""
    ranking = growth.look_ahead.ranking
    actions = replace(ranking.actions, first=np.array(placements))
    return replace(growth, look_ahead=replace(growth.look_ahead, ranking=replace(ranking, actions=actions)))


@pytest.fixture
def root(growth):
    return TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))


@pytest.mark.parametrize("order", [1, -1])
def test_a_squeeze_that_tells_costs_one_and_one_that_does_not_is_dropped(growth, root, order):
    angles = [TELLING, SILENT][::order]
    telling, silent = costs(root, [Action(placed(a)) for a in angles], growth, [1], untold, in_time)[::order]
    assert telling == pytest.approx(growth.objective.costs.least)
    assert silent == np.inf
    assert root.squeeze is None
    assert not root.children


def test_those_that_cost_about_as_much_are_judged_twice(growth, root, monkeypatch):
    seeds = []

    def cost(root, action, growth, seed, *_):
        seeds.append(tuple(seed))
        return growth.objective.costs.least * (1.0 + action.placement[0] / SIDEWAYS)

    monkeypatch.setattr("planner.search.hasty._cost", cost)
    offs = (0.0, 0.1 * SIDEWAYS, SIDEWAYS)
    row = [Action(placed(SILENT, off)) for off in offs]
    told = []
    found = costs(root, row, growth, [1], lambda done, waiting: told.append((done, waiting)), in_time)
    assert found == pytest.approx([0.01, 0.011, np.inf])
    assert len(seeds) == len(set(seeds)) == 5
    assert told == [(0, 3), (1, 2), (2, 1), (3, 2), (4, 1)]


def test_the_first_squeeze_is_that_of_the_cheapest_tree(growth, root):
    squeeze_first(root, with_first(growth, [placed(SILENT, SIDEWAYS), placed(TELLING)]), [1])
    assert root.squeeze.placement == pytest.approx(placed(TELLING))
    assert all(leaf.mode.ratio == 1.0 for leaf in breadth_first(root) if not leaf.children)


def test_where_the_trees_do_not_decide_the_next_best_stays_an_alternative(growth, root):
    squeeze_first(root, with_first(growth, [placed(TELLING, SIDEWAYS), placed(TELLING)]), [1])
    assert root.squeeze.placement == pytest.approx(placed(TELLING))
    assert [other.placement for other in root.alternatives] == [pytest.approx(placed(TELLING, SIDEWAYS))]
    decided = TreeNode(root.belief, 1.0, root.mode)
    squeeze_first(decided, with_first(growth, [placed(SILENT, SIDEWAYS), placed(TELLING)]), [1])
    assert decided.alternatives == []


def test_nothing_is_squeezed_where_there_is_no_choice_or_no_time(growth, root):
    squeeze_first(root, with_first(growth, [placed(TELLING)]), [1])
    assert root.squeeze is None
    squeeze_first(
        root, with_first(growth, [placed(SILENT, SIDEWAYS), placed(TELLING)]), [1], out_of_time=lambda: True
    )
    assert root.squeeze is None


def test_first_squeezes_are_unlike_those_about_the_middle_first_and_not_too_many(growth, root, monkeypatch):
    """Many placements in a row: no more trees are grown than are allowed, the middle's among them."""
    tried = []

    def cost(node, action, *_):
        tried.append(action.placement[0])
        return 1.0

    monkeypatch.setattr("planner.search.hasty._cost", cost)
    row = [placed(SILENT, x) for x in np.arange(-24.0, 25.0, 2.0)]
    squeeze_first(root, with_first(growth, row), [1], out_of_time=lambda: bool(tried))
    params = SearchParams()
    first = tried[: len(tried) // 2]
    assert first[0] == 0.0
    assert 2 <= len(first) <= params.first_candidates
    apart = np.abs(np.subtract.outer(np.abs(first), np.abs(first)))[~np.eye(len(first), dtype=bool)]
    assert apart.min() >= params.alike_mm


def test_a_leaf_where_little_effort_gains_nothing_stays_open_to_more(growth, root):
    silent = replace(growth, look_ahead=look_ahead([SILENT]))
    grow_hastily(root, silent, [1], untold, in_time)
    assert not root.children
    assert growth.worth_growing(root, 1.0)
    root.exhausted, root.searched = root.mode.ratio, len(root.belief)
    grow_hastily(root, silent, [1], untold, in_time)
    assert not growth.worth_growing(root, 1.0)
    root.searched = len(root.belief) // 2  # more particles show rarer poses
    grow_hastily(root, silent, [1], untold, in_time)
    assert growth.worth_growing(root, 1.0)
