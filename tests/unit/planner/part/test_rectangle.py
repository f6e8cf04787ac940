"""The smallest rectangle about an outline, against turned rectangles and a search over angles."""

import numpy as np
import pytest

from planner.part.outline import smallest_rectangle


def turned(points, degrees):
    angle = np.radians(degrees)
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points, dtype=float) @ np.array([[c, s], [-s, c]])


@pytest.mark.parametrize("degrees", [0, 12, 45, 89, 90, -30])
def test_a_turned_rectangle_is_found(degrees):
    result = smallest_rectangle(turned([(0, 0), (42, 0), (42, 26), (0, 26)], degrees))
    assert (result.length_mm, result.width_mm) == pytest.approx((42.0, 26.0))
    assert (result.turn_deg - degrees + 90.0) % 180.0 == pytest.approx(90.0, abs=1e-6)
    assert ("turned" in result.text()) is (degrees % 90 != 0)


def test_no_other_angle_gives_less_area():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(12, 2)) * (20.0, 9.0)
    result = smallest_rectangle(points)
    least = min(
        np.prod(np.ptp(turned(points, angle), axis=0)) for angle in np.arange(0.0, 90.0, 0.5)
    )
    assert result.length_mm * result.width_mm <= least + 1e-9
