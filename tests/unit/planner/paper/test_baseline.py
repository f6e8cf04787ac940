"""The time of a sensorless plan is computed by the model of time that tables use."""

import numpy as np
import pytest

from planner.job.cell import timing_of
from planner.job.model import Job
from planner.paper.baseline import seconds_of
from runtime.table import Visit


def one_squeeze_s(job: Job, width_mm: float) -> float:
    visit = Visit(
        way_mm=0.0,
        turn_rad=0.0,
        opening_mm=job.gripper.opening_mm,
        contact_mm=None,
        width_mm=width_mm,
        speed_mm_s=job.gripper.speed_mm_s,
        next_mm=job.gripper.opening_mm,
        from_retreat=True,
        to_retreat=True,
    )
    return timing_of(job).squeeze(visit).total_s


def test_seconds_of_one_squeeze_equal_the_timing_model(job: Job) -> None:
    widths = np.array([[20.0], [20.0], [35.0]])
    expected = (2 * one_squeeze_s(job, 20.0) + one_squeeze_s(job, 35.0)) / 3
    assert seconds_of(job, np.zeros(1), widths) == pytest.approx(expected)
