"""The answer for a located part: its pose, and its name and frames where the table has several parts."""

import json
from dataclasses import replace

import pytest
from sample_tables import several_table, small_table, with_job

from runtime.table import Table
from runtime.traversal.answer import PartFrames, fields, frames_of
from runtime.traversal.results import Outcome, PartResult

LEFT = {"datum": [1.0, 2.0, 90.0], "picks": {"rim": [3.0, 0.0, 0.0]}}
RIGHT = {"datum": [-1.0, 0.0, 0.0]}


def with_parts(table: Table) -> Table:
    return with_job(table, json.dumps({"hypothesis": [{"part": LEFT}, {"part": RIGHT}]}))


def at(leaf: int, turn_urad: int = 0) -> PartResult:
    return PartResult(1, Outcome.LEAF, (), leaf, None, 0, turn_urad=turn_urad)


def test_fields_of_turned_plan_give_pose_of_part() -> None:
    table = with_parts(several_table())
    result = fields(table, at(0, 1_570_796), frames_of(table))
    assert result["x_mm"] == pytest.approx(-0.5)
    assert result["datum"] == {"x_mm": -2.5, "y_mm": 1.0, "angle_deg": 180.0}


def test_fields_of_several_parts_use_frames_of_located_part():
    table = with_parts(several_table())
    one, other = (fields(table, at(leaf), frames_of(table)) for leaf in (0, 1))
    assert (one["hypothesis"], other["hypothesis"]) == ("left hand", "right hand")
    # The leaf is at (0, 0.5), 0 deg.
    assert one["datum"] == {"x_mm": 1.0, "y_mm": 2.5, "angle_deg": 90.0}
    assert one["picks"] == {"rim": {"x_mm": 1.0, "y_mm": 5.5, "angle_deg": 90.0}}
    turned = pytest.approx(90.0, abs=0.02)
    assert other["datum"] == {"x_mm": -1.2, "y_mm": -3.0, "angle_deg": turned}
    assert other["picks"] == {}


def test_fields_of_single_part_have_no_hypothesis():
    table = small_table()
    assert "hypothesis" not in fields(table, at(0), frames_of(table))


@pytest.mark.parametrize("job", [None, "{}", "[", '{"hypothesis": [{}, 3]}', '{"hypothesis": 7}'])
def test_frames_of_unreadable_job_are_empty(job):
    table = replace(several_table(), job=None) if job is None else with_job(several_table(), job)
    assert frames_of(table) == (PartFrames(None, {}), PartFrames(None, {}))
