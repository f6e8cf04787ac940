"""Poses that no squeeze distinguishes are named before the search, if the goal asks to distinguish them."""

import numpy as np
import pytest
from problems import regular_polygon
from programs import TREES

from planner import compile as compiling
from planner.diagnosis.alike import alike
from planner.errors import NoPlanError
from planner.job import model as job_file

JOB = job_file.load(TREES / "ratchet" / "job.toml")


def box(length, width):
    return [[0, 0], [length, 0], [length, width], [0, width]]


def ring(n):
    return np.round(regular_polygon(n, 14.0), 4).tolist()


def chamfered(cut):
    return [[0, 0], [30, 0], [30, 20 - cut], [30 - cut, 20], [0, 20]]


def job_of(outline, symmetry=1, **changes):
    return JOB.replaced(part={"outline_mm": outline, "symmetry": symmetry}, **changes)


@pytest.mark.parametrize(
    ("outline", "stated", "order"),
    [
        (box(30, 20), 1, 2),
        (box(20, 20), 1, 4),
        (box(20, 20), 2, 4),
        (ring(6), 1, 6),
        (ring(6), 3, 6),
        (ring(9), 3, 9),
    ],
    ids=["box 1", "square 1", "square 2", "hexagon 1", "hexagon 3", "nonagon 3"],
)
def test_compile_job_understated_symmetry_is_refused_before_the_search(
    outline, stated, order, monkeypatch
):
    monkeypatch.setattr(compiling, "planned", None)
    job = job_of(outline, stated)
    with pytest.raises(NoPlanError) as error:
        compiling.compile_job(job)
    message = str(error.value)
    assert "no squeeze distinguishes" in message
    assert f"which is {order}" in message
    turn = alike(job)[0].degrees  # is a symmetry of the outline, but not of the stated order
    assert order * turn % 360.0 == pytest.approx(0.0, abs=1e-6)
    assert stated * turn % 360.0 != pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"uncertainty": {"orientation_halfwidth_deg": 20.0}},
        {"goal": {"kind": "modes", "modes": 2}},
        {"goal": {"distance_mm": 60.0}},
    ],
)
def test_alike_turn_that_needs_no_distinction_is_left_out(changes):
    assert alike(job_of(box(30, 20), 1, **changes)) == []


def test_alike_difference_below_one_count_is_reported_but_not_hopeless():
    (result,) = alike(job_of(chamfered(0.2), "auto"))
    assert (result.degrees, result.hopeless) == (pytest.approx(180.0), False)
    assert "the gripper resolves 0.37 mm" in result.line()
    assert alike(job_of(chamfered(1.0), "auto")) == []


def test_alike_limited_orientation_states_the_share_of_ambiguous_parts():
    (result,) = alike(job_of(box(30, 20), 1, uncertainty={"orientation_halfwidth_deg": 120.0}))
    assert result.share == pytest.approx(0.5, abs=0.01)  # parts turned by more than 60 degrees
    assert not result.hopeless
    assert "50% of the parts" in result.line()


def test_alike_asymmetric_pressure_is_not_hopeless():
    pressure = {"kind": "points", "points_mm": [[3.0, 2.0], [27.0, 2.0], [15.0, 12.0]]}
    assert not alike(job_of(box(30, 20), 1, pressure=pressure))[0].hopeless
