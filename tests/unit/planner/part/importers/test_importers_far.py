"""Drawings far from their origin are read as if they lay near it.

The datum of such a drawing's job is a point of the part, since the drawing's origin is too far away.
"""

import math

import numpy as np
import pytest
from drawings import arc, area, dxf, lines, read

from planner.cli import init
from planner.job import model as job_file

BRACKET = np.array([(0, 0), (40, 0), (40, 10), (15, 10), (15, 25), (0, 25)], dtype=float)
FLAGS = ["--radius=3", "--turn=20", "--gripper=robotiq-2f-85", "--fingers=rubber", "--thickness=10"]


@pytest.mark.parametrize("site_mm", [(0, -10_050), (5e8, 3e8), (-3.4e9, 5.8e9)])
@pytest.mark.parametrize(("units", "unit_mm"), [(4, 1.0), (6, 1000.0)])
def test_init_drawing_far_away_has_its_datum_at_the_part(tmp_path, units, unit_mm, site_mm):
    points = ((BRACKET + site_mm) / unit_mm).tolist()
    path = dxf(tmp_path, lambda space, _: space.add_lwpolyline(points, close=True), units)
    assert init.main([str(path), "-o", str(tmp_path / "job.toml"), *FLAGS]) == 0
    part = job_file.load(tmp_path / "job.toml").part
    near = part.outline_mm - part.datum[:2]
    assert np.allclose(near.min(axis=0), 0.0, atol=1e-3)
    assert np.allclose(np.sort(near, axis=0), np.sort(BRACKET, axis=0), atol=2e-3)


BULGE = math.tan(math.pi / 8)
CORNERS = [(0.3, 0, 0), (39.7, 0, BULGE), (40, 0.3, 0), (40, 19.7, BULGE)]
CORNERS += [(39.7, 20, 0), (0.3, 20, BULGE), (0, 19.7, 0), (0, 0.3, BULGE)]
GAP = [(0, 0), (5, 0), (5, 4), (0, 4), (0, 0.3)]


def bulges(space, at):
    points = np.add(CORNERS, (*at, 0))
    space.add_lwpolyline(points, format="xyb", close=True)


def strokes(space, at):
    lines(space, arc(at, 0.7, 0, math.tau, 400)[:-1])


SMALL = {  # function that draws at (x, y), and the area [mm2]
    "bulges": (bulges, 800 - (4 - math.pi) * 0.3**2),
    "disc": (lambda space, at: space.add_circle(at, 0.8), math.pi * 0.8**2),
    "ellipse": (lambda space, at: space.add_ellipse(at, (3, 0), 0.2), math.pi * 3 * 0.6),
    "spline": (lambda space, at: space.add_spline(arc(at, 1.5, 0, math.tau, 32)), math.pi * 1.5**2),
    "short last stroke": (lambda space, at: space.add_lwpolyline(np.add(GAP, at), close=True), 20),
    "short strokes": (strokes, math.pi * 0.7**2),
}


@pytest.mark.parametrize(("draw", "mm2"), SMALL.values(), ids=SMALL)
@pytest.mark.parametrize("site_mm", [(0, 0), (5e9, -3e9)])
@pytest.mark.parametrize("block", [False, True])
def test_read_small_shape_far_away_keeps_its_area(tmp_path, draw, mm2, site_mm, block):
    def place(space, document):
        if block:
            space.add_blockref("PART", (7, 5))
        draw(document.blocks.new("PART") if block else space, site_mm)

    assert area(read(dxf(tmp_path, place), tolerance_mm=0.002)) == pytest.approx(mm2, rel=4e-3)
