"""Reasons of parts that are not located, where geometry says what they are."""

import math

import numpy as np
import pytest
from problems import l_shape
from programs import TREES

from planner.diagnosis import reasons
from planner.diagnosis.advice import Advice
from planner.diagnosis.reasons import likeness, nearest_turn, no_plan, reason
from planner.errors import NoPlanError
from planner.job import model as job_file

JOB = job_file.load(TREES / "ratchet" / "job.toml")


def job_of(outline):
    return JOB.replaced(part={"outline_mm": outline, "symmetry": "auto"})


def advice(**values):
    return Advice(0.5, 0.0, 0.0, 0.0, 0.0, [], (), proposing=True, shares=None)._replace(**values)


def notched(depth):
    """A box with a notch 2 mm wide in one of its short sides."""
    right = [[15, -8], [15, -1], [15 - depth, -1], [15 - depth, 1], [15, 1], [15, 8]]
    return [[-15, -8], *right, [-15, 8]]


def test_a_turn_that_is_a_symmetry_is_not_reported():
    box = np.array([[-15, -8], [15, -8], [15, 8], [-15, 8]], dtype=float)
    assert nearest_turn(box, 1) == (pytest.approx(180.0), pytest.approx(0.0, abs=1e-9))
    assert nearest_turn(box, 2).apart_mm > 3.0


@pytest.mark.parametrize("depth", [0.1, 0.15])
def test_a_notch_below_a_count_makes_half_turns_alike(depth):
    result = likeness(job_of(notched(depth)))
    assert result.kind == reasons.BELOW
    assert "180 degrees" in result.text
    apart = nearest_turn(job_of(notched(depth)).part.outline_mm, 1).apart_mm
    assert 0.5 * depth <= apart <= 1.5 * depth


def test_a_narrow_notch_is_out_of_the_fingers_reach_and_a_bent_part_is_neither():
    result = likeness(job_of(notched(6.0)))
    assert result.kind == reasons.REACH
    assert likeness(job_of(l_shape().tolist())) is None


def test_without_a_plan_the_part_is_blamed_before_the_search_and_a_cut_search_before_the_reach():
    cut, bent = NoPlanError("x: no leaf comes within 3.0 mm"), job_of(l_shape().tolist())
    assert no_plan(bent, cut).kind == reasons.ALIKE
    assert no_plan(job_of(notched(6.0)), cut).kind == reasons.REACH
    cut.cut_short = True
    assert no_plan(bent, cut).kind == reasons.TIME
    assert no_plan(job_of(notched(6.0)), cut).kind == reasons.TIME
    assert no_plan(job_of(notched(0.1)), cut).kind == reasons.BELOW
    start = NoPlanError("x: no first squeeze is free of collision")
    assert no_plan(bent, start).kind == reasons.NO_START


def test_the_first_cause_that_applies_is_reported():
    bent = job_of(l_shape().tolist())
    assert reason(bent, advice(unresolved=0.5), cut=True).kind == reasons.TIME
    assert reason(bent, advice(unresolved=0.5, at_depth_limit=0.4), cut=False).kind == reasons.DEPTH
    assert reason(bent, advice(rejected=0.3), cut=True).kind == reasons.REJECTED
    assert reason(bent, advice(rejected=0.3, pinched=0.3), cut=True).kind == reasons.THIN
    assert reason(bent, advice(rejected=0.3, pinched=0.1), cut=True).kind == reasons.REJECTED
    assert reason(bent, advice(), cut=False).kind == reasons.SCATTER
    assert math.isfinite(nearest_turn(bent.part.outline_mm, 1).apart_mm)
