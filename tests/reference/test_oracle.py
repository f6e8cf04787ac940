"""Thirty squeezes each of a rectangle and a butterfly against the mechanics of the paper's authors."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from problems import rectangle, simulator

from planner.mechanics.limit_surface import LimitSurface
from planner.part.outline import canonical

DATA = Path(__file__).parents[2].parent / "shared" / "data"
RECTANGLE = LimitSurface(np.diag([1.04824883, 1.06257935, 0.57763835]), 10.5711873)
BUTTERFLY = LimitSurface(np.diag([1.05777596, 1.03317228, 0.71206246]), 11.4495255)
FRICTION = 0.5
CLOSE_MM, CLOSE_RAD = 0.3, math.radians(1.0)


@pytest.fixture
def data():
    if not DATA.is_dir():
        pytest.skip(f"the reference squeezes are not here: no folder {DATA}")
    return DATA


def squeezes(path):
    """Reads recorded squeezes: initial and final poses (n, 3) [mm, mm, rad], and final openings (n,) [mm]."""
    with path.open(newline="") as file:
        names = ("x0_m", "y0_m", "th0_rad", "x_m", "y_m", "th_rad", "opening_m")
        table = [[float(row[name]) for name in names] for row in csv.DictReader(file)]
    numbers = np.array(table) * [1e3, 1e3, 1, 1e3, 1e3, 1, 1e3]
    return np.ascontiguousarray(numbers[:, :3]), numbers[:, 3:6], numbers[:, 6]


def assert_all_reproduced(outline, surface, path):
    initial, final, opening = squeezes(path)
    part = simulator(outline, surface=surface)
    result = part.roll_out(initial, part.nominal(len(initial), FRICTION))
    offset = result.poses - final
    turned = (offset[:, 2] + math.pi) % math.tau - math.pi
    close = (
        (np.hypot(offset[:, 0], offset[:, 1]) < CLOSE_MM)
        & (np.abs(turned) < CLOSE_RAD)
        & (np.abs(result.width_mm - opening) < CLOSE_MM)
    )
    assert len(initial) == 30
    assert close.all(), f"off at rows {np.flatnonzero(~close).tolist()} of {path.name}"


def test_roll_out_rectangle_ends_as_in_mechanics_of_authors(data):
    assert_all_reproduced(rectangle(), RECTANGLE, data / "oracle_rect.csv")


def test_roll_out_butterfly_ends_as_in_mechanics_of_authors(data):
    outline = 1e3 * np.loadtxt(data / "butterfly_outline.csv", delimiter=",", skiprows=1)
    # Its origin is near enough to its centroid.
    assert np.abs(canonical(outline).shift_mm).max() < 0.05
    assert_all_reproduced(np.ascontiguousarray(outline), BUTTERFLY, data / "oracle_butterfly.csv")
