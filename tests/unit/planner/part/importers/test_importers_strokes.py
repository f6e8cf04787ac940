"""Strokes that are short or end near each other: chains keep their shape, and gaps are closed."""

import math

import numpy as np
import pytest
import shapely
from drawings import PLATE_MM2, arc, area, box, dxf, lines, read
from ezdxf.math import Matrix44

FILLET_MM2 = PLATE_MM2 - (4 - math.pi)  # one corner of the plate with a fillet of 2 mm


def filleted(count, radius=2.0):
    """Points and area of the plate's outline with one fillet, which consists of `count` chords."""
    corner = arc((40 - radius, 20 - radius), radius, 0, math.pi / 2, count)
    points = [(0, 0), (40, 0), *corner, (0, 20)]
    return points, shapely.Polygon(points).area


@pytest.mark.parametrize(("count", "noise_mm"), [(20, 1e-4), (200, 0.0), (1000, 1e-9)])
def test_read_strokes_shorter_than_the_tolerance_keep_their_shape(tmp_path, count, noise_mm):
    points, right = filleted(count)
    noise = np.random.default_rng(count).uniform(-noise_mm, noise_mm, (2 * len(points), 2))

    def draw(space, _):
        for k, start in enumerate(points):
            end = points[(k + 1) % len(points)]
            space.add_line(np.add(start, noise[2 * k]), np.add(end, noise[2 * k + 1]))

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(right, abs=0.02 * 120)
    assert shapely.Polygon(part.outline_mm).hausdorff_distance(_centred(points)) < 0.03


def _centred(points):
    whole = shapely.Polygon(points)
    return shapely.transform(whole, lambda xy: xy - np.array(whole.centroid.coords[0]))


def short_arc(space, a, b):
    first, last = (math.degrees(math.atan2(y - 18, x - 38)) for x, y in (a, b))
    space.add_arc((38, 18), 2.0, first, last)


def short_polyline(space, a, b):
    space.add_lwpolyline([a, np.add(a, b) / 2, b])


def short_spline(space, a, b):
    space.add_open_spline([(*a, 0), (*np.add(a, b) / 2, 0), (*b, 0)], degree=2)


def short_line_of_any_sense(space, a, b):
    space.add_line(*((b, a) if a[0] % 0.02 < 0.01 else (a, b)))


SHORT = (short_arc, short_polyline, short_spline, short_line_of_any_sense)


@pytest.mark.parametrize("add", SHORT)
def test_read_short_strokes_of_any_kind_form_the_outline(tmp_path, add):
    points = arc((38, 18), 2.0, 0, math.pi / 2, 200)

    def draw(space, _):
        for a, b in zip(points[:-1].tolist(), points[1:].tolist(), strict=True):
            add(space, a, b)
        lines(space, [(38, 20), (0, 20), (0, 0), (40, 0), (40, 18)], close=False)

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(FILLET_MM2, rel=4e-4)


BOTTOM = ((0, 0), (40, 0))
RIGHT = ((40, 0), (40, 20))
TOP = ((40, 20), (0, 20))
LEFT = ((0, 20), (0, 0))
GAPS = {
    "at a corner": [BOTTOM, ((40, 0.015), (40, 20)), TOP, LEFT],
    "at each corner": [
        *(((0.01, y), (39.99, y)) for y in (0, 20)),
        *(((x, 0.01), (x, 19.99)) for x in (0, 40)),
    ],
    "a corner that overshoots": [((-0.01, 0), (40, 0)), RIGHT, TOP, LEFT],
    "a tee that falls short": [BOTTOM, RIGHT, ((45, 20), (0, 20)), ((0, 20), (0, 0.012))],
    "an edge in halves": [((0, 0), (20, 0)), ((20.015, 0), (40, 0)), RIGHT, TOP, LEFT],
}


@pytest.mark.parametrize("strokes", GAPS.values(), ids=GAPS)
def test_read_narrow_gaps_are_closed(tmp_path, strokes):
    def draw(space, _):
        for ends in strokes:
            space.add_line(*ends)

    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2, rel=1e-3)


@pytest.mark.parametrize("where_mm", [(12e3, -500), (-3.4e9, 5.8e9)])
@pytest.mark.parametrize("turn", [0.0, 0.3])
def test_read_shifted_and_turned_drawing_keeps_its_area_and_holes(tmp_path, where_mm, turn):
    points, right = filleted(200)

    def draw(space, _):
        lines(space, points)
        space.add_line((12, 0), (12, 20))
        box(space, (20, 5), (20.4, 9))
        space.add_circle((30, 10), 0.4)
        matrix = Matrix44.chain(Matrix44.z_rotate(turn), Matrix44.translate(*where_mm, 0))
        for entity in space:
            entity.transform(matrix)

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(right, rel=4e-4)
    assert len(part.holes_mm) == 2
