"""The sentences at the top of a report: the verdict on a plan, and the result of a cell."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rectangle import JOB_PATH, TABLE_PATH

from planner.diagnosis.cautions import warnings_of
from planner.evaluation.cases import Case, Condition
from planner.evaluation.evaluate import Line
from planner.job import model as job_file
from planner.report.run_log import PartLog, RunLog
from planner.report.verdict import cell_result, listed, verdict
from runtime.table import load

JOB, TABLE = job_file.load(JOB_PATH), load(TABLE_PATH).table
FIGURES = {
    "trials": 4000,
    "crashes": 0,
    "success_rate": 0.999,
    "wrong_rate": 0.0005,
    "unresolved_rate": 0.0005,
    "reject_rate": 0.0,
    "mean_squeezes": 2.2,
    "seconds_mean": 5.8,
    "error_mm": {"median": 0.7, "p95": 1.7},
}


def world(name, wrong=0.0, success=None, broken=None):
    """The row of a world with a share of wrong answers; the other answers are right by default."""
    success = 1.0 - wrong if success is None else success
    figures = {"wrong_rate": wrong, "success_rate": success}
    rates = {"wrong": np.float64(wrong), "success": np.float64(success)}
    result = SimpleNamespace(**rates, summary=lambda: figures)
    return Line(Case(name, broken=broken), result)


PLANNED = world("as planned")
SKEWED = world("fingers that share 52:48", 0.18, 0.8)


def test_verdict_good_plan_states_part_success_and_error():
    result = verdict(JOB, FIGURES)
    assert result.grade == "good"
    assert "30 x 21 mm rectangle" in result.sentence
    assert "to 3 mm in 99.9 % of trials, 2.2 squeezes, about 5.8 s" in result.sentence
    assert result.error == "expected error 0.70 mm median, 95 % within 1.70 mm"


def test_verdict_assumption_with_wrong_answers_is_named_as_weakest():
    result = verdict(JOB, FIGURES, [PLANNED, SKEWED])
    assert result.grade == "fair"
    assert result.sentence.endswith("weakest assumption: fingers that share 52:48 (18 % wrong)")


@pytest.mark.parametrize("worse", [{"success_rate": 0.6}, {"wrong_rate": 0.05}])
def test_verdict_plan_far_from_the_goal_is_poor(worse):
    assert verdict(JOB, FIGURES | worse).grade == "poor"


def test_cell_result_all_located_is_good_and_failed_audit_is_poor():
    parts = [PartLog(k, [], "leaf", 0) for k in range(1, 4)]
    assert cell_result(TABLE, RunLog(parts, 1, 0, "", "")).grade == "good"
    parts[0] = replace(parts[0], audit="fail")
    result = cell_result(TABLE, RunLog(parts, 1, 0, "", ""))
    assert result == ("poor", "2 of 3 parts located, 1 refuted by the audit")


def test_verdict_of_worlds_that_were_not_tried_claims_nothing_about_them():
    assert "it holds where" in verdict(JOB, FIGURES, [PLANNED, world("friction 1.3", 0.0)]).sentence
    partly = verdict(JOB, FIGURES, [PLANNED, world("friction 1.3", 0.0)], ["a", "b", "c"]).sentence
    assert "it holds where" not in partly
    assert "3 assumptions were not tried" in partly


def test_verdict_conditions_keep_the_strictest_of_each_kind():
    lines = [
        PLANNED,
        world("friction 0.9", 0.02, broken=Condition("friction", "below", 0.9)),
        world("friction 1.35", 0.06, broken=Condition("friction", "below", 1.35)),
        world("friction 0.25", 0.004, broken=Condition("friction", "above", 0.25)),
        world("52 %", 0.01, broken=Condition("the share", "below", 52.0, " %")),
        world("39 %", 0.05, broken=Condition("the share", "above", 39.0, " %")),
    ]
    result = verdict(JOB, FIGURES, lines)
    assert result.grade == "fair"
    assert result.conditions == ["friction stays below 0.9", "the share stays between 39 and 52 %"]
    assert listed(result.conditions) == f"if {result.conditions[0]} and {result.conditions[1]}"
    assert listed([]) == ""
    assert listed(list("abcde")).endswith("a, b, c and 2 more assumptions hold")


def outlined(length, width, **changes):
    outline = [[0, 0], [length, 0], [length, width], [0, width]]
    return JOB.replaced(
        part={"outline_mm": outline, "symmetry": "auto", **changes.pop("part", {})}, **changes
    )


@pytest.mark.parametrize(
    ("job", "words"),
    [
        (
            outlined(30, 21, part={"height_mm": 2.0}, cell={"squeeze_height_mm": 1.0}),
            ["1 mm above", "below the top"],
        ),
        (
            outlined(30, 21, part={"height_mm": 9.0}, cell={"squeeze_height_mm": 8.0}),
            ["below the top"],
        ),
        (
            outlined(30, 21, part={"height_mm": 20.0}, cell={"squeeze_height_mm": 1.5}),
            ["1.5 mm above"],
        ),
        (outlined(3, 2.2), ["2.2 mm wide"]),
        (outlined(40, 5), ["5 mm wide"]),
        (outlined(30, 21, goal={"distance_mm": 11.0}), ["21 mm wide"]),
        (outlined(30, 21), []),
    ],
)
def test_verdict_warnings_are_those_of_the_job(job, words):
    result = verdict(job, FIGURES).warnings
    assert result == warnings_of(job)
    assert len(result) == len(words)
    for word, warning in zip(words, result, strict=True):
        assert word in warning
