"""A limit on wrong answers: which leaves are to blame, when a study ends, what is given up."""

from pathlib import Path

import numpy as np
import pytest

from planner.belief.metric import Mode
from planner.belief.particles import Belief
from planner.evaluation import ppm, rare
from planner.evaluation.judge import metric_of_table
from planner.evaluation.ppm import Findings, Sums, Wrong
from planner.evaluation.rare import AIM, AMPLIFIED, Case, given_up, settle, studied, unsettle
from planner.job import model as job_file
from planner.mechanics.traits import as_planned
from planner.search.expand import TreeNode
from planner.work.progress import silent
from planner.work.scheduler import Threads
from runtime.table import PPM, load

TREES = Path(__file__).parents[4] / "trees" / "rectangle"
PARTS = 1_000_000


@pytest.fixture(scope="module")
def job():
    return job_file.load(TREES / "job.toml")


@pytest.fixture(scope="module")
def table():
    return load(TREES / "rectangle.msgpack").table


@pytest.fixture
def small(monkeypatch):
    """Studies of at most eight small chunks."""
    for module in (ppm, rare):
        monkeypatch.setattr(module, "CHUNK", 500)
    monkeypatch.setattr(rare, "MOST_PARTS", 8 * 500)


def case(visits, wrong):
    """What a study of a million parts found; every wrong part lies at a place that tells its leaf."""
    wrong = np.array(wrong, np.float64)
    squares = np.append(wrong, wrong.sum())
    sums = Sums(PARTS, np.array(visits, np.float64), wrong, squares, 0.0, 0.0, 3.0 * PARTS)
    leaf = np.repeat(np.arange(len(wrong)), wrong.astype(int))
    places = np.column_stack([leaf, leaf, leaf]).astype(float)
    return Case(Findings.of(sums), Wrong(leaf, places, leaf, as_planned(len(leaf))))


def test_the_leaves_that_are_wrong_for_most_of_their_parts_are_blamed_first():
    found = case([500_000, 400_000, 1_000, 99_000], [60, 0, 40, 50])
    assert list(found.to_blame(120)) == [2, 3]
    assert list(found.to_blame(60)) == [2, 3, 0]
    assert found.to_blame(2 * 150 / (2 * AIM)) == {}


@pytest.mark.parametrize("limit", [1, 30, 100, 250])
def test_what_is_left_alone_keeps_well_below_the_limit_and_nothing_more_is_blamed(limit):
    wrong = [3, 80, 0, 45, 7, 1]
    found = case([10_000, 300_000, 500_000, 90_000, 50_000, 50_000], wrong)
    blamed = found.to_blame(limit)
    assert sum(wrong) - sum(wrong[leaf] for leaf in blamed) <= AIM * limit
    if blamed:
        spared = list(blamed)[:-1]
        assert sum(wrong) - sum(wrong[leaf] for leaf in spared) > AIM * limit
    for leaf, parts in blamed.items():
        assert len(parts) == wrong[leaf]
        assert np.all(parts.poses == leaf)
        assert np.all(parts.reading == leaf)


def planted(table, leaf, off_um=50_000):
    """The table with one leaf that says a place where no part lies."""
    rows = list(table.leaves)
    rows[leaf] = rows[leaf]._replace(x_um=rows[leaf].x_um + off_um)
    return type(table)(**{**{name: getattr(table, name) for name in table.__slots__}, "leaves": tuple(rows)})


def test_a_planted_leaf_is_found_at_the_first_look_and_blamed_alone(table, job, small):
    leaf = max(range(len(table.leaves)), key=lambda k: table.leaves[k].trials)
    found = studied(planted(table, leaf), job, 1000, 3, Threads(1), silent)
    assert found.found.sums.parts == rare.FIRST * rare.CHUNK
    assert found.found.wrong.low > 1000
    assert list(found.to_blame(50_000)) == [leaf]
    spoilt = given_up(planted(table, leaf), [leaf])
    assert [k for k, row in enumerate(spoilt.leaves) if not row.resolved and table.leaves[k].resolved] == [
        leaf
    ]
    again = studied(spoilt, job, 10_000, 3, Threads(1), silent)
    assert again.found.sums.wrong[leaf] == 0.0


def test_an_undecided_study_ends_with_what_it_has_and_on_any_number_of_workers(table, job, small):
    limit = 150  # one wrong part in the first thousand decides nothing yet
    one, two = (studied(table, job, limit, 5, Threads(workers), silent) for workers in (1, 2))
    assert one.found.sums.parts == 8 * 500
    assert one.found.sums.document() == two.found.sums.document()
    assert np.array_equal(one.wrong.poses, two.wrong.poses)
    assert one.found.wrong.low < limit < one.found.wrong.high < PPM
    assert f"NOT shown to be below wrong_ppm = {limit}" in one.found.verdict(limit)


def tree():
    """A root with four leaves."""
    belief = Belief.of(np.zeros((50, 3)))
    root = TreeNode(belief, 1.0, Mode(np.zeros(3), 0.5))
    root.children = [TreeNode(belief, 0.25, Mode(np.zeros(3), 1.0), (k,)) for k in range(4)]
    return root


def wrong_parts(n):
    """Parts that lie well away from the others."""
    return Belief.of(np.arange(3.0 * n).reshape(n, 3) + 10.0)


def test_a_leaf_to_blame_is_joined_by_its_wrong_parts_so_many_that_they_count(table):
    root, metric, wrong = tree(), metric_of_table(table), wrong_parts(7)
    (found,) = unsettle(root, {1: wrong}, metric)
    leaf = root.children[1]
    assert found.node is leaf
    assert np.array_equal(leaf.belief.poses[:50], found.belief.poses)
    joined = leaf.belief[50:]
    assert {tuple(pose) for pose in joined.poses} == {tuple(pose) for pose in wrong.poses}
    assert AMPLIFIED <= len(joined) / len(leaf.belief) < 2.0 * AMPLIFIED + 0.1
    assert leaf.doubted == len(joined)
    assert leaf.mode.ratio == metric.mode(leaf.belief.poses).ratio


def test_a_leaf_to_blame_that_no_squeeze_improves_is_what_it_was(table):
    root = tree()
    before = [(leaf.belief, leaf.mode) for leaf in root.children]
    doubts = unsettle(root, {k: wrong_parts(3) for k in range(4)}, metric_of_table(table))
    grown = root.children[2]
    grown.children = [TreeNode(grown.belief, 0.25, grown.mode, (2, 0))]
    settle(doubts, 2.0)
    for k, (leaf, (belief, mode)) in enumerate(zip(root.children, before, strict=True)):
        assert (leaf.belief is belief) == (leaf.mode is mode) == (leaf.doubted == 0) == (k != 2)


def test_a_leaf_to_blame_keeps_a_pose_that_holds_for_the_wrong_ones_too(table):
    root = tree()
    (found,) = unsettle(root, {1: wrong_parts(7)}, metric_of_table(table))
    joined = found.node.mode
    settle([found], joined.ratio)
    assert found.node.mode is joined
    settle([found], joined.ratio + 1e-9)
    assert found.node.mode is found.mode
