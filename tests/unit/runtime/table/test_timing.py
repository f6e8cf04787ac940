"""The model of time against the laws of motion, and the values of a job's cell that are refused."""

import json
from math import pi

import pytest
from sample_tables import small_table, with_job

from runtime.table import Schedule, TableError, dumps
from runtime.table.timing import NEAR_MM, Visit, trapezoid_s

VISIT = Visit(0.0, 0.0, 85.0, None, 25.0, 60.0, 85.0)


def timing(**cell: float):
    return Schedule.of(small_table(), {"cell": cell}).timing


@pytest.mark.parametrize("way_mm", [0.0, 1.0, 31.0, 32.0, 500.0])
def test_trapezoid_s_covers_way_within_speed_and_acceleration(way_mm):
    speed, acceleration = 250.0, 2000.0
    seconds = trapezoid_s(way_mm, speed, acceleration)
    ramp_s = min(speed / acceleration, seconds / 2)
    area_mm = acceleration * ramp_s * (seconds - ramp_s)  # under the profile
    assert area_mm == pytest.approx(way_mm)


def test_move_s_of_turn_equals_arc_at_turn_radius():
    cell = timing()
    assert cell.move_s(3.0, pi / 2) == cell.move_s(cell.turn_radius_mm * pi / 2)
    assert cell.move_s(0.0) == 0.0


def test_squeeze_first_visit_descends_on_the_way_if_near_and_faster():
    cell = Schedule.of(small_table(), {"hypothesis": [{"part": {"height_mm": 16.0}}]}).timing
    first = VISIT._replace(from_retreat=True)
    again = VISIT._replace(turn_rad=pi / 2)
    turned = cell.squeeze(first._replace(turn_rad=pi / 2))
    assert turned.lower_s == cell.squeeze(again).lower_s
    assert turned.travel_s == pytest.approx(cell.squeeze(again).travel_s)
    for change in ({}, {"turn_rad": 0.1}, {"way_mm": 2 * NEAR_MM, "turn_rad": pi / 2}):
        assert cell.squeeze(first._replace(**change)).lower_s > turned.lower_s


@pytest.mark.parametrize(
    ("cell", "problem"),
    [
        ({"arm_acceleration_mm_s2": 0}, "arm_acceleration_mm_s2 .* no motion can keep"),
        ({"arm_acceleration_mm_s2": -5.0}, "no motion can keep"),
        ({"poll_s": -1}, "poll_s"),
        ({"regrasp_height_mm": 9.0}, "belongs above the part"),
        ({"regrasp_height_mm": 61.0}, "at most at the retreat height"),
        ({"regrasp_height_mm": "high"}, "regrasp_height_mm"),
    ],
)
def test_dumps_job_with_impossible_motion_is_refused(cell, problem):
    table = with_job(small_table(), json.dumps({"cell": cell}))
    with pytest.raises(TableError, match=problem):
        dumps(table)
