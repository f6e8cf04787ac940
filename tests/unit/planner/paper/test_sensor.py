"""The sensor model agrees with simulated widths and with geometry."""

import math

import numpy as np
import pytest
from problems import rectangle, rolled

from planner.paper.sensor import sensor_model


@pytest.fixture(scope="module")
def widths():
    known = rolled(rectangle(), 15_000, 30.0, seed=1)
    return sensor_model(known.poses, known.width_mm, order=2)


def test_sensor_model_predicts_unseen_widths(widths):
    fresh = rolled(rectangle(), 6000, 30.0, seed=2)
    error = np.abs(widths(fresh.poses) - fresh.width_mm)
    # The encoder's noise is 0.15 mm and its counts are 0.37 mm wide.
    assert np.median(error) < 0.05
    assert np.quantile(error, 0.95) < 0.25


def test_sensor_model_flush_and_jammed_poses_have_geometric_widths(widths):
    # Between the fingers the rectangle at angle t is 30 |sin t| + 21 |cos t| wide; it rests flush, or jams
    # where friction holds it on a diagonal.
    for turn, width in ((0.0, 21.0), (math.pi / 2, 30.0), (math.pi - 0.95, math.hypot(30.0, 21.0))):
        for copy in (turn, turn + math.pi, turn - math.pi):
            assert widths(np.array([[0.0, 0.0, copy]]))[0] == pytest.approx(width, abs=0.5)
    far = np.array([[40.0, 0.0, 0.3], [-45.0, 3.0, 1.0]])
    assert np.array_equal(widths(far), [0.0, 0.0])
