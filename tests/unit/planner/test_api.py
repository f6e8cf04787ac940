"""The table as arrays says what the runtime's own look-up says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.api import Job, Table, evaluate
from planner.errors import PlannerError
from runtime.table import COUNTS, REJECT, Calibration, by_count, decision_map

FOLDER = Path(__file__).parents[3] / "trees" / "rectangle"


@pytest.fixture(scope="module")
def table():
    return Table.load(FOLDER / "rectangle.msgpack")


def test_lookup_is_the_decision_of_the_runtime_for_every_count_at_every_node(table):
    calibration = Calibration.linear(table.record.gripper)
    for number, node in enumerate(table.record.nodes):
        found = table.lookup(np.full(COUNTS, number), np.arange(COUNTS))
        for count, branch in enumerate(by_count(decision_map(node, calibration))):
            target = None if branch == REJECT else node.branches[branch].target
            expected = (-1, -1) if target is None else (target, -1) if target >= 0 else (-1, ~target)
            assert (found.nodes[count], found.leaves[count]) == expected


def test_a_table_is_the_same_after_its_file(table, tmp_path):
    table.save(tmp_path / "again.msgpack")
    assert (tmp_path / "again.msgpack").read_bytes() == (FOLDER / "rectangle.msgpack").read_bytes()
    assert table.job == Job.load(FOLDER / "job.toml")


def test_an_evaluation_is_that_of_the_seed_on_any_number_of_workers(table):
    one, two = (evaluate(table, trials=1500, seed=5, workers=workers) for workers in (1, 2))
    assert np.array_equal(one.poses, two.poses)
    assert not np.array_equal(one.poses, evaluate(table, trials=1500, seed=6).poses)
    assert table.resolved[one.leaf[one.success]].all()
    near = np.hypot(*(table.poses[one.leaf] - one.poses)[one.success, :2].T)
    assert near.max() < 3.0


def test_a_table_without_its_job_says_so(table):
    stripped = Table.of(replace(table.record, job=None))
    with pytest.raises(PlannerError, match="carries no job"):
        evaluate(stripped, trials=10)
