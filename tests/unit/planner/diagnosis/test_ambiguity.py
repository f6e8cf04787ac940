"""Poses left open: found where parts lie, and told apart only where the shape allows it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from problems import l_shape
from rectangle import JOB_PATH

from planner.diagnosis.ambiguity import ambiguities
from planner.evaluation.evaluate import evaluate
from planner.frames import to_hand, wrap
from planner.job import model as job_file
from planner.mechanics.simulator import Simulator
from planner.world import ContactWorlds


@pytest.fixture(scope="module")
def marked():
    """The rectangle with a mark that no jaw feels: its half-turns count, and nothing tells them apart."""
    return job_file.load(JOB_PATH, {"part": {"symmetry": 1}})


@pytest.fixture(scope="module")
def table(table):
    leaves = tuple(leaf._replace(resolved=False) for leaf in table.leaves)
    return replace(table, leaves=leaves, goal=replace(table.goal, symmetry=1))


@pytest.fixture(scope="module")
def evaluation(table, marked):
    return evaluate(table, marked, ContactWorlds.of_job(marked, 1), 2000, 2)


def test_half_turns_of_a_symmetric_part_stay_open_and_nothing_tells(table, marked, evaluation):
    result = ambiguities(table, evaluation, marked)
    assert len(result) == 3
    for row in result:
        assert len(row.where.poses) == 2
        assert abs(wrap(row.where.poses[0, 2] - row.where.poses[1, 2] - math.pi)) < 0.2
        assert np.hypot(*(row.where.poses[0] - row.where.poses[1])[:2]) < 3.0
        assert row.where.shares == pytest.approx((0.5, 0.5), abs=0.1)
        assert row.separator is None
        assert "no squeeze" in row.line()
    shares = [row.share for row in result]
    assert shares == sorted(shares, reverse=True)


def test_what_separates_two_poses_of_an_l_does_so(table, marked, evaluation):
    job = marked.replaced(part={"outline_mm": l_shape()})
    rng = np.random.default_rng(3)
    n = len(evaluation.leaf)
    turn = np.where(rng.random(n) < 0.6, 0.0, math.pi)
    poses = np.column_stack([0.3 * rng.normal(size=(n, 2)), turn + 0.02 * rng.normal(size=n)])
    open_leaf = replace(evaluation, leaf=np.zeros(n, np.int64), poses=poses)
    (row,) = ambiguities(table, open_leaf, job)
    assert row.where.shares == pytest.approx((0.6, 0.4), abs=0.05)
    assert row.share == 1.0
    simulator = Simulator.of_job(job)
    hand = np.repeat(to_hand(row.where.poses, row.separator.placement), 200, axis=0)
    width = simulator.roll_out(hand, simulator.sample(400, rng)).width_mm.reshape(2, 200)
    assert width.mean(axis=1) == pytest.approx(row.separator.widths_mm, abs=0.5)
    assert abs(np.diff(width.mean(axis=1))[0]) > 3.0 * width.std(axis=1).max()
    assert width.mean() > 2.0
    assert f"{row.separator.widths_mm[0]:.1f} mm for the first" in row.line()


def in_one_leaf(evaluation, poses):
    return replace(evaluation, leaf=np.zeros(len(poses), np.int64), poses=poses)


def scattered(n, rng, mm):
    return np.column_stack([mm * rng.normal(size=(n, 2)), 0.001 * rng.normal(size=n)])


def test_a_pose_that_few_parts_have_is_named_with_its_share(table, marked, evaluation):
    job = marked.replaced(part={"outline_mm": l_shape()})
    n = len(evaluation.leaf)
    poses = scattered(n, np.random.default_rng(4), 0.2)
    poses[: n // 50, 2] += math.pi
    (row,) = ambiguities(table, in_one_leaf(evaluation, poses), job)
    assert row.where.shares == pytest.approx((0.98, 0.02), abs=1e-9)
    assert abs(wrap(row.where.poses[0, 2] - row.where.poses[1, 2] - math.pi)) < 0.1
    assert row.separator is not None
    assert "(98.0%) or" in row.line()
