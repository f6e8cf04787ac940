"""Certificates of tables: what they cover, and that plans lie above them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.bound.certificate import certify
from planner.bound.placements import covered
from planner.job import model as job_file
from runtime.table import Prediction, load

TREES = Path(__file__).parents[4] / "trees"
ANGLES = 4


@pytest.fixture(scope="module")
def table():
    return load(TREES / "rectangle" / "rectangle.msgpack").table


@pytest.fixture(scope="module")
def job(table):
    return job_file.from_canonical(table.job)


@pytest.fixture(scope="module")
def found(job, table):
    return certify(job, table, parts=4000, workers=2)


def test_the_plan_lies_above_its_bound_and_the_bound_above_what_every_plan_takes(found, table):
    assert 2.0 < found.squeezes < found.mean
    assert found.squeezes == max(found.leaves.squeezes, found.overall.squeezes)
    for term in (found.leaves, found.overall):
        assert term.squeezes < term.estimate < found.mean
    assert found.success < table.predicted.success_ppm / 1e6


def test_the_seed_decides_and_the_workers_do_not(found, job, table):
    assert certify(job, table, parts=4000, workers=1) == found


def test_a_worse_plan_is_further_above_the_same_bound(found, job, table):
    measured = table.predicted
    worse = replace(
        table,
        predicted=replace(measured, mean_squeezes_ppm=measured.mean_squeezes_ppm + 1_000_000),
    )
    other = certify(job, worse, parts=4000, workers=2)
    assert other.squeezes == found.squeezes
    gap = other.figures()["above_bound"] - found.figures()["above_bound"]
    assert gap == pytest.approx(1.0 / found.squeezes)
    assert f"{other.mean / other.squeezes - 1.0:.1%}" in other.lines()[0]


def test_a_table_that_located_nothing_is_compared_with_plans_that_need_not(job, table):
    failed = replace(table, predicted=Prediction(0, 1000, 3_000_000))
    assert certify(job, failed, parts=500, workers=2).squeezes == 1.0


def test_turned_plans_are_covered_once(job, table):
    parts = np.zeros((50, 3))
    alone = covered(job, table, dense=False)
    assert len(alone.first) == 1  # the four angles are one up to a turn
    own = [node.squeeze for node in table.nodes]
    reading = next(r for r in range(512) if np.isfinite(alone.own[r]).all())
    second = alone(1, reading, parts)
    assert len(second) == ANGLES + 1
    assert [round(1e3 * x) for x in second[-1][:2]] in [[s.x_um, s.y_um] for s in own]
    narrow = job.replaced(uncertainty={"orientation_halfwidth_deg": 30.0})
    assert len(covered(narrow, table, dense=False).first) == ANGLES
    uneven = job.replaced(gripper={"upper_finger_share": 0.4})
    assert len(covered(uneven, table, dense=False).first) == ANGLES  # half a turn is another squeeze
    dense = covered(job, table, dense=True)
    assert len(dense.first) == 2  # over the middle, and to one side of it
    assert len(dense(1, reading, parts)) == len(second) + 36


def test_placements_beside_the_middle_differ_by_more_than_a_turn(table):
    job = job_file.load(TREES / "rectangle-25" / "job.toml")
    centres = job.actions.centers_mm[:, 0]
    first = covered(job, table, dense=False).first
    # Half a turn makes each centre its opposite; the middle one has its angles' opposites itself.
    assert len(first) == ANGLES * (np.sum(centres > 0.0) + 1)
