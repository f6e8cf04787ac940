"""Drawings at site coordinates: read as if they lay near their origin, with a datum that a job takes."""

import math

import numpy as np
import pytest
from drawings import area, dxf, read

from planner.cli import init
from planner.job import model as job_file

BRACKET = [(0, 0), (40, 0), (40, 10), (15, 10), (15, 25), (0, 25)]
FLAGS = [
    "--radius",
    "3",
    "--turn",
    "20",
    "--gripper",
    "robotiq-2f-85",
    "--fingers",
    "rubber",
    "--thickness",
    "10",
]
SITES_MM = [(12e3, 500), (0, -10_050), (5e8, 3e8), (-3.4e9, 5.8e9), (2.5e9, 0)]


def moved(points, by, unit_mm=1.0):
    return [((x + by[0]) / unit_mm, (y + by[1]) / unit_mm) for x, y in points]


@pytest.mark.parametrize("site_mm", SITES_MM)
@pytest.mark.parametrize("units", [4, 6])
def test_job_of_a_drawing_far_away_has_a_datum_at_the_part(tmp_path, capsys, site_mm, units):
    def draw(space, _):
        space.add_lwpolyline(moved(BRACKET, site_mm, {4: 1.0, 6: 1000.0}[units]), close=True)

    path, output = dxf(tmp_path, draw, units), tmp_path / "job.toml"
    assert init.main([str(path), "-o", str(output), *FLAGS]) == 0
    printed = capsys.readouterr().out
    part = job_file.parse(output.read_text(), "job").part
    assert "too far for a datum" in printed
    corner = ", ".join(f"{value:.12g}" for value in site_mm)
    assert f"({corner}) mm in the drawing" in printed
    assert np.allclose(part.datum[:2], part.outline_mm.min(axis=0), atol=1e-3)
    drawn = np.array(BRACKET, dtype=float)
    assert np.allclose(
        np.sort(part.outline_mm - part.datum[:2], axis=0), np.sort(drawn, axis=0), atol=2e-3
    )


def small_bulges(space, x, y):
    """A plate with corners of 0.3 mm as bulges, in one polyline."""
    b = math.tan(math.pi / 8)
    corners = [
        (0.3, 0, 0),
        (39.7, 0, b),
        (40, 0.3, 0),
        (40, 19.7, b),
        (39.7, 20, 0),
        (0.3, 20, b),
        (0, 19.7, 0),
        (0, 0.3, b),
    ]
    space.add_lwpolyline(
        [(x + px, y + py, bulge) for px, py, bulge in corners], format="xyb", close=True
    )
    return 800 - (4 - math.pi) * 0.3**2


def small_disc(space, x, y):
    space.add_circle((x, y), 0.8)
    return math.pi * 0.8**2


def small_ellipse(space, x, y):
    space.add_ellipse((x, y), (3, 0), 0.2)
    return math.pi * 3 * 0.6


def small_spline(space, x, y):
    ring = [(x + 1.5 * math.cos(a), y + 1.5 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 33)]
    space.add_spline(ring)
    return math.pi * 1.5**2


def closed_by_a_short_stroke(space, x, y):
    points = [(0, 0), (5, 0), (5, 4), (0, 4), (0, 0.3)]
    space.add_lwpolyline([(x + px, y + py) for px, py in points], close=True)
    return 20.0


def short_strokes(space, x, y):
    angles = np.linspace(0, 2 * math.pi, 401)[:-1]
    points = [(x + 0.7 * math.cos(a), y + 0.7 * math.sin(a)) for a in angles]
    for k, point in enumerate(points):
        space.add_line(point, points[(k + 1) % len(points)])
    return math.pi * 0.7**2


SMALL = (
    small_bulges,
    small_disc,
    small_ellipse,
    small_spline,
    closed_by_a_short_stroke,
    short_strokes,
)


@pytest.mark.parametrize("draw", SMALL)
@pytest.mark.parametrize("site_mm", [(0, 0), (5e9, -3e9)])
@pytest.mark.parametrize("block", [False, True])
def test_small_shapes_keep_their_form_far_away(tmp_path, draw, site_mm, block):
    right = []

    def place(space, document):
        layout = document.blocks.new("PART") if block else space
        if block:
            space.add_blockref("PART", (7, 5))
        right.append(draw(layout, *site_mm))

    assert area(read(dxf(tmp_path, place), tolerance_mm=0.002)) == pytest.approx(right[0], rel=4e-3)
