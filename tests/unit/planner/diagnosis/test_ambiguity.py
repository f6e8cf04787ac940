"""Leaves whose parts lie in several poses, and the squeeze, if there is one, that would distinguish them."""

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
    """The rectangle's job with symmetry order 1, as if its two ends had different marks.

    Poses half a turn apart then count as different, but no squeeze distinguishes them.
    """
    return job_file.load(JOB_PATH, {"part": {"symmetry": 1}})


@pytest.fixture(scope="module")
def table(table):
    """The rectangle's table with all leaves unresolved."""
    leaves = tuple(leaf._replace(resolved=False) for leaf in table.leaves)
    return replace(table, leaves=leaves, goal=replace(table.goal, symmetry=1))


@pytest.fixture(scope="module")
def evaluation(table, marked):
    return evaluate(table, marked, ContactWorlds.of_job(marked, 1), 2000, 2)


def in_one_leaf(evaluation, poses):
    return replace(evaluation, leaf=np.zeros(len(poses), np.int64), poses=poses)


def test_ambiguities_symmetric_part_has_half_turns_and_no_separator(table, marked, evaluation):
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


def test_ambiguities_l_shape_separator_gives_distinct_widths(table, marked, evaluation):
    job = marked.replaced(part={"outline_mm": l_shape()})
    rng = np.random.default_rng(3)
    n = len(evaluation.leaf)
    turn = np.where(rng.random(n) < 0.6, 0.0, math.pi)
    poses = np.column_stack([0.3 * rng.normal(size=(n, 2)), turn + 0.02 * rng.normal(size=n)])
    (row,) = ambiguities(table, in_one_leaf(evaluation, poses), job)
    assert row.where.shares == pytest.approx((0.6, 0.4), abs=0.05)
    assert row.share == 1.0
    simulator = Simulator.of_job(job)
    hand = np.repeat(to_hand(row.where.poses, row.separator.placement), 200, axis=0)
    width = simulator.roll_out(hand, simulator.sample(400, rng)).width_mm.reshape(2, 200)
    assert width.mean(axis=1) == pytest.approx(row.separator.widths_mm, abs=0.5)
    assert abs(np.diff(width.mean(axis=1))[0]) > 3.0 * width.std(axis=1).max()
    assert width.mean() > 2.0
    assert f"{row.separator.widths_mm[0]:.1f} mm for the first" in row.line()


def test_ambiguities_rare_pose_is_named_with_its_share(table, marked, evaluation):
    job = marked.replaced(part={"outline_mm": l_shape()})
    rng = np.random.default_rng(4)
    n = len(evaluation.leaf)
    poses = np.column_stack([0.2 * rng.normal(size=(n, 2)), 0.001 * rng.normal(size=n)])
    poses[: n // 50, 2] += math.pi
    (row,) = ambiguities(table, in_one_leaf(evaluation, poses), job)
    assert row.where.shares == pytest.approx((0.98, 0.02), abs=1e-9)
    assert abs(wrap(row.where.poses[0, 2] - row.where.poses[1, 2] - math.pi)) < 0.1
    assert row.separator is not None
    assert "(98.0%) or" in row.line()
