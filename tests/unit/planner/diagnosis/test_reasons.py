"""The stated reasons why a part is not located, for outlines and figures whose reason is known."""

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


def test_nearest_turn_leaves_out_the_stated_symmetry():
    box = np.array([[-15, -8], [15, -8], [15, 8], [-15, 8]], dtype=float)
    assert nearest_turn(box, 1) == (pytest.approx(180.0), pytest.approx(0.0, abs=1e-9))
    assert nearest_turn(box, 2).apart_mm > 3.0
    assert math.isfinite(nearest_turn(l_shape(), 1).apart_mm)


@pytest.mark.parametrize("depth", [0.1, 0.15])
def test_likeness_shallow_notch_is_below_one_count(depth):
    result = likeness(job_of(notched(depth)))
    assert result.kind == reasons.BELOW
    assert "180 degrees" in result.text
    apart = nearest_turn(job_of(notched(depth)).part.outline_mm, 1).apart_mm
    assert 0.5 * depth <= apart <= 1.5 * depth


def test_likeness_narrow_notch_is_out_of_reach_and_l_shape_has_none():
    result = likeness(job_of(notched(6.0)))
    assert result.kind == reasons.REACH
    assert likeness(job_of(l_shape().tolist())) is None


BENT, NOTCHED, SHALLOW = job_of(l_shape().tolist()), job_of(notched(6.0)), job_of(notched(0.1))
NO_LEAF, NO_START = "x: no leaf comes within 3.0 mm", "x: no first squeeze is free of collision"


@pytest.mark.parametrize(
    ("job", "message", "cut", "kind"),
    [
        (BENT, NO_LEAF, False, reasons.ALIKE),
        (NOTCHED, NO_LEAF, False, reasons.REACH),
        (BENT, NO_LEAF, True, reasons.TIME),
        (NOTCHED, NO_LEAF, True, reasons.TIME),  # a hull is no proof where the search was cut short
        (SHALLOW, NO_LEAF, True, reasons.BELOW),
        (BENT, NO_START, False, reasons.NO_START),
    ],
    ids=["L", "notch", "L cut", "notch cut", "shallow notch cut", "L without a start"],
)
def test_no_plan_returns_likeness_before_the_search_as_its_reason(job, message, cut, kind):
    error = NoPlanError(message)
    error.cut_short = cut
    assert no_plan(job, error).kind == kind


@pytest.mark.parametrize(
    ("values", "cut", "kind"),
    [
        ({"unresolved": 0.5}, True, reasons.TIME),
        ({"unresolved": 0.5, "at_depth_limit": 0.4}, False, reasons.DEPTH),
        ({"rejected": 0.3}, True, reasons.REJECTED),
        ({"rejected": 0.3, "pinched": 0.3}, True, reasons.THIN),
        ({"rejected": 0.3, "pinched": 0.1}, True, reasons.REJECTED),
        ({}, False, reasons.SCATTER),
    ],
)
def test_reason_returns_the_first_cause_that_applies(values, cut, kind):
    assert reason(BENT, advice(**values), cut).kind == kind
