"""The sensorless plan's seconds are those of the table's model of time."""

from pathlib import Path

import numpy as np
import pytest

from planner.job import model as job_file
from planner.job.cell import timing_of
from planner.paper.baseline import seconds_of
from runtime.table import Visit

JOB = job_file.load(Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml")
OPENING_MM = JOB.gripper.opening_mm


def one_squeeze_s(width_mm: float) -> float:
    visit = Visit(
        way_mm=0.0,
        turn_rad=0.0,
        opening_mm=OPENING_MM,
        contact_mm=None,
        width_mm=width_mm,
        speed_mm_s=JOB.gripper.speed_mm_s,
        next_mm=OPENING_MM,
        from_retreat=True,
        to_retreat=True,
    )
    return timing_of(JOB).squeeze(visit).total_s


def test_seconds_of_one_squeeze_are_the_models() -> None:
    widths = np.array([[20.0], [20.0], [35.0]])
    expected = (2 * one_squeeze_s(20.0) + one_squeeze_s(35.0)) / 3
    assert seconds_of(JOB, np.zeros(1), widths) == pytest.approx(expected)
