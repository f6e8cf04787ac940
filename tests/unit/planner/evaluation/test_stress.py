"""Which leaves are doubted, what the search is shown of them, and what becomes of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.belief.metric import Mode
from planner.belief.particles import Belief
from planner.evaluation.cases import OFFSET_COUNTS, UNEVEN, stress_cases
from planner.evaluation.evaluate import evaluate
from planner.evaluation.judge import metric_of_table
from planner.evaluation.stress import (
    AMPLIFIED,
    TOLERATED,
    doubt,
    doubtful,
    settle,
    stressed,
)
from planner.job import model as job_file
from planner.mechanics.traits import ordinary
from planner.search.expand import TreeNode
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime.table import load

TREES = Path(__file__).parents[4] / "trees" / "rectangle"


@pytest.fixture(scope="module")
def job():
    return job_file.load(TREES / "job.toml", {"goal": {"stress_trials": 500}})


@pytest.fixture(scope="module")
def table():
    return load(TREES / "rectangle.msgpack").table


@pytest.fixture(scope="module")
def run(table, job):
    return evaluate(table, job, ContactWorlds.of_job(job, 1), 2000, 2)


def with_wrong(run, counts):
    """The run with parts spread over leaves 0 to 3, so many of them wrong in each."""
    n = len(run.leaf)
    leaf = np.arange(n) % 4
    within = np.ones(n, np.bool_)
    for number, count in enumerate(counts):
        within[np.flatnonzero(leaf == number)[:count]] = False
    return replace(run, leaf=leaf, within=within, resolved=np.ones(n, np.bool_))


@pytest.mark.parametrize(
    ("wrong", "expected"),
    [
        ((0, 0, 0, 0), []),
        ((4, 0, 0, 0), []),  # 4 of 2000 are tolerated
        ((5, 0, 0, 0), [0]),
        ((2, 9, 2, 0), [1]),
        ((2, 9, 3, 0), [1, 2]),
        ((30, 40, 10, 20), [1, 0, 3, 2]),
    ],
)
def test_the_fewest_leaves_are_doubted_that_bring_the_rest_below_what_is_tolerated(run, wrong, expected):
    found = with_wrong(run, wrong)
    assert doubtful(found, 4) == expected
    left = sum(count for leaf, count in enumerate(wrong) if leaf not in expected)
    assert left <= TOLERATED * len(run.leaf)


def tree():
    """A root with four leaves."""
    belief = Belief.of(np.zeros((50, 3)))
    root = TreeNode(belief, 1.0, Mode(np.zeros(3), 0.5))
    root.children = [TreeNode(belief, 0.25, Mode(np.zeros(3), 1.0), (k,)) for k in range(4)]
    return root


def test_a_doubted_belief_is_joined_by_the_parts_that_were_wrong_there_so_many_that_they_count(run, table):
    root, metric = tree(), metric_of_table(table)
    runs = [with_wrong(run, (0, 7, 0, 0)), with_wrong(run, (0, 2, 0, 0))]
    (found,) = doubt(root, runs, metric)
    leaf = root.children[1]
    assert found.node is leaf
    assert np.array_equal(leaf.belief.poses[:50], found.belief.poses)
    wrong = np.concatenate([r.poses[(r.leaf == 1) & ~r.within] for r in runs])
    joined = leaf.belief[50:]
    assert ordinary(joined.traits).all()
    assert {tuple(pose) for pose in joined.poses} == {tuple(pose) for pose in wrong}
    assert AMPLIFIED <= len(joined) / len(leaf.belief) < 2.0 * AMPLIFIED + 0.1
    assert leaf.mode.ratio == metric.mode(leaf.belief.poses).ratio


def test_a_doubted_leaf_that_no_squeeze_improves_is_what_it_was(run, table):
    root = tree()
    before = [(leaf.belief, leaf.mode) for leaf in root.children]
    doubts = doubt(root, [with_wrong(run, (30, 40, 10, 20))], metric_of_table(table))
    assert [doubted.node for doubted in doubts] == root.children
    grown = root.children[2]
    grown.children = [TreeNode(grown.belief, 0.25, grown.mode, (2, 0))]
    settle(doubts, 2.0)
    for k, (leaf, (belief, mode)) in enumerate(zip(root.children, before, strict=True)):
        assert (leaf.belief is belief) == (leaf.mode is mode) == (k != 2)


def test_a_doubted_leaf_keeps_a_pose_that_holds_for_the_wrong_ones_too(run, table):
    root, metric = tree(), metric_of_table(table)
    (found,) = doubt(root, [with_wrong(run, (0, 7, 0, 0))], metric)
    joined = found.node.mode
    settle([found], joined.ratio)
    assert found.node.mode is joined
    settle([found], joined.ratio + 1e-9)
    assert found.node.mode is found.mode


def test_worlds_are_off_to_both_sides_of_the_planned_one(job):
    short, long, slippery, rough, less, more, _ = stress_cases(job)
    count = job.gripper.opening_mm / (job.gripper.count_closed - job.gripper.count_open)
    assert long.disturbance.encoder_offset_mm == pytest.approx(OFFSET_COUNTS * count)
    assert short.disturbance.encoder_offset_mm == -long.disturbance.encoder_offset_mm
    planned = job.friction
    below, above = (case.job(job).friction for case in (slippery, rough))
    assert 0.0 < below.finger_part_min < below.finger_part_max == planned.finger_part_min
    assert planned.finger_part_max == above.finger_part_min < above.finger_part_max
    shares = [case.job(job).gripper.upper_finger_share for case in (less, more)]
    assert shares == pytest.approx([0.5 - UNEVEN, 0.5 + UNEVEN])
    assert less.disturbance.across_mm == pytest.approx(-more.disturbance.across_mm)


def test_a_finger_that_sticks_by_plan_can_only_move_more(job):
    stuck = job.replaced(gripper={"upper_finger_share": 0})
    assert [case.name for case in stress_cases(stuck)][4:-1] == ["upper finger moves 10%, centred"]


def test_runs_are_the_same_on_any_number_of_workers_and_none_are_made_without_trials(job, table):
    one, two = (stressed(table, job, 1, Threads(workers)) for workers in (1, 2))
    assert len(one) == len(two) == len(stress_cases(job))
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.poses, b.poses)
        assert len(a.leaf) == 500
    off = job.replaced(goal={"stress_trials": 0})
    assert stressed(table, off, 1, Threads(1)) == []
