"""The sentences that a report begins with: the plan's verdict and the cell's own result."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from planner.job import model as job_file
from planner.report.run_log import PartLog, RunLog
from planner.report.verdict import Weakest, cell_result, percent, planned_spans, verdict
from runtime.table import Calibration, load

TREE = Path(__file__).parents[4] / "trees" / "rectangle"
JOB, TABLE = job_file.load(TREE / "job.toml"), load(TREE / "rectangle.msgpack").table
FIGURES = {
    "success_rate": 0.999, "wrong_rate": 0.0005, "mean_squeezes": 2.2, "mean_seconds": 5.8,
    "error_mm": {"median": 0.7, "p95": 1.7},
}  # fmt: skip
SKEWED = Weakest("fingers that share 52:48", 0.18, 0.8)


def test_a_good_plan_says_what_it_finds_how_well_and_what_it_leans_on():
    found = verdict(JOB, FIGURES, None)
    assert found.grade == "good"
    assert "30 x 21 mm rectangle" in found.sentence
    assert "to 3 mm in 99.9 % of trials, 2.2 squeezes, about 5.8 s" in found.sentence
    assert found.error == "expected error 0.70 mm median, 95 % within 1.70 mm"


def test_an_assumption_that_makes_it_wrong_is_a_weakness():
    found = verdict(JOB, FIGURES, SKEWED)
    assert found.grade == "fair"
    assert found.sentence.endswith("weakest assumption: fingers that share 52:48 (18 % wrong)")


@pytest.mark.parametrize("worse", [{"success_rate": 0.6}, {"wrong_rate": 0.05}])
def test_a_plan_that_misses_the_goal_by_far_is_poor(worse):
    assert verdict(JOB, FIGURES | worse, None).grade == "poor"


@pytest.mark.parametrize(
    ("share", "told"), [(1.0, "100 %"), (0.0, "0 %"), (0.99996, "99.996 %"), (0.5, "50 %")]
)
def test_a_share_is_never_rounded_to_all_or_nothing(share, told):
    assert percent(share) == told


def test_parts_rejected_at_one_node_are_told_with_what_was_read_and_planned():
    wide = Calibration.linear(TABLE.gripper).count(50_000)
    parts = [PartLog(k, [(0, wide, None)], "reject") for k in range(1, 9)]
    found = cell_result(TABLE, RunLog(parts, 1, 0, "", ""))
    assert found.grade == "poor"
    assert "0 of 8 parts located, 8 reject; 8 rejected at node 0: 50.2 mm read" in found.sentence
    assert found.sentence.endswith("planned: another part?")


def test_all_parts_located_is_good_and_an_audit_that_fails_is_not():
    parts = [PartLog(k, [], "leaf", 0) for k in range(1, 4)]
    assert cell_result(TABLE, RunLog(parts, 1, 0, "", "")).grade == "good"
    parts[0] = replace(parts[0], audit="fail")
    assert cell_result(TABLE, RunLog(parts, 1, 0, "", "")).grade == "poor"


def test_spans_hold_every_branch_and_do_not_meet():
    for node in TABLE.nodes:
        spans = planned_spans(node)
        assert all(high < low for (_, high), (low, _) in pairwise(spans))
        for branch in node.branches:
            assert any(low <= branch.low_um / 1e3 and branch.high_um / 1e3 <= high for low, high in spans)
