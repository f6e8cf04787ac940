"""Drawings whose lines overlap, cross or share an edge: the outline that they mean."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from drawings import PLATE, PLATE_MM2, arc, area, box, dxf, lines, notes, read, refused

from planner.part.importers import noding


def strokes(*ends):
    """Draws each pair of ends as a line."""

    def draw(space, _):
        for one, other in ends:
            space.add_line(one, other)

    return draw


def polyline(points, **how):
    return lambda space, _: space.add_lwpolyline(points, **how)


def all_of(*draws):
    return lambda space, document: [draw(space, document) for draw in draws]


def circles(*circles):
    return lambda space, _: [space.add_circle(*circle) for circle in circles]


def rectangle(x0, y0, x1, y1, **how):
    """Draws the edges of a rectangle as lines."""
    return lambda space, _: lines(space, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)], **how)


ALL = rectangle(0, 0, 40, 20)
NEARLY = [(0.004, 0.003), (40.003, -0.004), (39.997, 20.003), (0.002, 19.996)]
DOUBLE = {
    "halves": all_of(rectangle(0, 0, 25, 20), rectangle(15, 0, 40, 20)),
    "overlapping strokes": all_of(ALL, strokes(((15, 0), (40, 0)), ((40, 12), (40, 20)))),
    "nearly upon each other": all_of(ALL, lambda space, _: lines(space, NEARLY)),
    "polyline and lines": all_of(ALL, polyline(PLATE, close=True)),
    "crossing": strokes(
        *(((-5, y), (45, y)) for y in (0, 20)), *(((x, -5), (x, 25)) for x in (0, 40))
    ),
    "lap and a half": polyline([*PLATE, *PLATE[:3]]),
    "spur": polyline([(0, 0), (40, 0), (50, 0), (40, 0), (40, 20), (0, 20)], close=True),
    "thrice": all_of(ALL, ALL, ALL),
}


@pytest.mark.parametrize("draw", DOUBLE.values(), ids=DOUBLE)
def test_read_double_and_crossing_lines_return_the_plate(tmp_path, draw):
    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2, rel=2e-3)


def test_read_arc_drawn_as_several_curves_is_one(tmp_path):
    """The same half circle is drawn as an ARC, as a bulge in the other direction, and as a spline."""

    def draw(space, _):
        space.add_line((0, 0), (40, 0))
        space.add_arc((20, 0), 20, 0, 180)
        space.add_lwpolyline([(0, 0, -1), (40, 0, 0)], format="xyb")
        space.add_spline(arc((20, 0), 20, 0, math.pi, 60))

    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(200 * math.pi, rel=2e-3)
    assert "drawn twice" in notes(part)


def bends(*xs, low=0.0, high=20.0, layer="BEND"):
    def draw(space, _):
        lines(space)
        for x in xs:
            space.add_line((x, low), (x, high), dxfattribs={"layer": layer})

    return draw


ACROSS = "from (12, 0) to (12, 20) mm"
SEAMS = {
    "tee": (bends(12), f"{ACROSS} (layer BEND)"),
    "overshoot": (bends(12, low=-3, high=24), f"{ACROSS} (layer BEND)"),
    "one layer": (bends(12, layer="0"), f"{ACROSS} (layer 0)"),
    "two": (bends(12, 25), "from (25, 0) to (25, 20) mm (layer BEND)"),
    "short by 0.01": (bends(12, low=0.01, high=19.99), f"{ACROSS} (layer BEND)"),
    "diagonal": (all_of(ALL, strokes(((0, 0), (40, 20)))), "from (0, 0) to (40, 20) mm"),
    "arc": (
        all_of(ALL, lambda space, _: space.add_arc((0, 0), 10, 0, 90)),
        "from (0, 10) to (10, 0)",
    ),
    "split outline": (all_of(rectangle(0, 0, 12, 20), rectangle(12, 0, 40, 20)), ACROSS),
    "grid": (all_of(bends(10, 30), strokes(((0, 8), (40, 8)))), "(layer BEND)"),
    "through a hole": (all_of(bends(20), circles(((20, 10), 4))), "(layer BEND)"),
}


@pytest.mark.parametrize(("draw", "sentence"), SEAMS.values(), ids=SEAMS)
def test_read_adjacent_regions_are_merged_and_their_edge_is_named(tmp_path, draw, sentence):
    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2, rel=1e-3)
    assert sentence in notes(part)
    assert "--layer" in notes(part)


CROSSED = {
    "notch across an edge": all_of(ALL, lambda space, _: box(space, (15, 15), (25, 25))),
    "circle at a corner": all_of(ALL, circles(((0, 0), 3))),
    "plus of two boxes": all_of(rectangle(0, 10, 40, 20), rectangle(15, 0, 25, 30)),
}


@pytest.mark.parametrize("draw", CROSSED.values(), ids=CROSSED)
def test_read_overlapping_closed_contours_are_refused(tmp_path, draw):
    refused(dxf(tmp_path, draw), r"closed contours overlap near \(.*draw the outline as one")


HOLE = circles(((20, 10), 5))
INSIDE = {
    "centre lines": all_of(HOLE, strokes(((-3, 10), (43, 10)), ((20, 25), (20, -5)))),
    "touching holes": circles(((20, 14), 5), ((25, 6), 3)),
    "lead-in": all_of(HOLE, strokes(((25, 10), (40, 10)))),
}


@pytest.mark.parametrize("inside", INSIDE.values(), ids=INSIDE)
def test_read_holes_and_centre_lines_leave_the_outline_as_it_is(tmp_path, inside):
    draw = all_of(polyline(PLATE, close=True), inside)
    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2, rel=1e-3)


def dimension_on(layer, beyond):
    """The exploded lines of a dimension: extension lines from two corners, and the line between them."""

    def draw(space, _):
        lines(space, layer="CUT")
        attributes = {"layer": layer}
        for x in (0, 40):
            space.add_line((x, 0), (x, -6 - beyond), dxfattribs=attributes)
        space.add_line((0, -6), (40, -6), dxfattribs=attributes)

    return draw


@pytest.mark.parametrize(("layer", "beyond"), [("DIM", 0), ("DIM", 2), ("CUT", 2)])
def test_read_dimension_lines_that_close_a_contour_are_refused(tmp_path, layer, beyond):
    path = dxf(tmp_path, dimension_on(layer, beyond))
    refused(path, r"from \(0, .*--layer")
    if layer == "DIM":
        assert area(read(path, layer="cut")) == pytest.approx(PLATE_MM2)


@pytest.mark.parametrize("seed", range(6))
def test_regions_random_lines_equal_the_union_by_shapely(seed):
    """The regions cover the same area as shapely's bounded faces; successive regions share no edge."""
    random = np.random.default_rng(seed)
    drawn = [random.integers(0, 12, (2, 2)).astype(float) for _ in range(14)]
    drawn = [line for line in drawn if (line[0] != line[1]).any()]
    bounded = noding.regions(drawn, 1e-3).regions
    noded = shapely.union_all([shapely.LineString(line) for line in drawn])
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    rings = [each.ring for each in bounded], [face.exterior.coords for face in faces]
    one, other = (shapely.union_all([shapely.Polygon(ring) for ring in each]) for each in rings)
    assert shapely.symmetric_difference(one, other).area < 1e-3
    for region, following in pairwise(bounded):
        shared = (shapely.LinearRing(each.ring) for each in (region, following))
        assert shapely.intersection(*shared).length < 1e-5


def test_read_wide_open_outline_about_a_hole_is_refused(tmp_path):
    def draw(space, _):
        space.add_lwpolyline([(0, 0), (40, 0), (40, 20), (0, 20)])  # not closed: 20 mm are missing
        space.add_circle((20, 10), 4)

    refused(dxf(tmp_path, draw), "20 mm away; close it")
