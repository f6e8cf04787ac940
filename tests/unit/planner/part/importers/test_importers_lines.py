"""Lines of drawings that lie upon each other, cross or share an edge: the outline that they mean."""

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from drawings import PLATE, PLATE_MM2, arc, area, box, dxf, lines, notes, read

from planner.part.importers import noding
from runtime.shell.errors import InputError


def halves(space, _):
    lines(space, [(0, 0), (25, 0), (25, 20), (0, 20)])
    lines(space, [(15, 0), (40, 0), (40, 20), (15, 20)])


def overlapping_strokes(space, _):
    space.add_line((0, 0), (25, 0))
    space.add_line((15, 0), (40, 0))
    space.add_line((40, 12), (40, 20))
    space.add_line((40, 0), (40, 20))
    lines(space, [(40, 20), (0, 20), (0, 0)], close=False)


def nearly_upon_each_other(space, _):
    lines(space)
    lines(space, [(0.004, 0.003), (40.003, -0.004), (39.997, 20.003), (0.002, 19.996)])


def polyline_and_lines(space, _):
    box(space, (0, 0), (40, 20))
    lines(space)


def crossing(space, _):
    space.add_line((-5, 0), (45, 0))
    space.add_line((-5, 20), (45, 20))
    space.add_line((0, -5), (0, 25))
    space.add_line((40, -5), (40, 25))


def lap_and_a_half(space, _):
    space.add_lwpolyline([*PLATE, *PLATE[:3]])


def twice_around(space, _):
    space.add_lwpolyline([*PLATE, *PLATE], close=True)


def spur(space, _):
    space.add_lwpolyline([(0, 0), (40, 0), (50, 0), (40, 0), (40, 20), (0, 20)], close=True)


def thrice(space, _):
    for k in range(3):
        lines(space, PLATE[k:] + PLATE[:k])


LINES = (
    halves,
    overlapping_strokes,
    nearly_upon_each_other,
    polyline_and_lines,
    crossing,
    lap_and_a_half,
    twice_around,
    spur,
    thrice,
)


@pytest.mark.parametrize("draw", LINES)
def test_double_and_crossing_lines_are_the_plate(tmp_path, draw):
    assert area(read(dxf(tmp_path, draw))) == pytest.approx(PLATE_MM2, rel=2e-3)


def test_arc_drawn_twice_otherwise_is_one(tmp_path):
    """Half discs as an ARC, as a bulge the other way round, and as a spline through them."""

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


def diagonal(space, _):
    lines(space)
    space.add_line((0, 0), (40, 20))


def quarter(space, _):
    lines(space)
    space.add_arc((0, 0), 10, 0, 90)


def split_outline(space, _):
    lines(space, [(12, 0), (0, 0), (0, 20), (12, 20)])
    lines(space, [(12, 20), (40, 20), (40, 0), (12, 0)], close=False)


def two_closed_halves(space, _):
    box(space, (0, 0), (12, 20))
    box(space, (12, 0), (40, 20))


def flange_on_a_closed_polyline(space, _):
    box(space, (0, 0), (28, 20))
    lines(space, [(28, 0), (40, 0), (40, 20), (28, 20)], close=False)


def grid_of_bends(space, _):
    bends(10, 30)(space, _)
    space.add_line((0, 8), (40, 8), dxfattribs={"layer": "BEND"})


def bend_through_a_hole(space, _):
    bends(20)(space, _)
    space.add_circle((20, 10), 4, dxfattribs={"layer": "HOLES"})


SEAMS = {
    "tee": (bends(12), "from (12, 0) to (12, 20) mm (layer BEND)"),
    "overshoot": (bends(12, low=-3, high=24), "from (12, 0) to (12, 20) mm (layer BEND)"),
    "one layer": (bends(12, layer="0"), "from (12, 0) to (12, 20) mm (layer 0)"),
    "two": (bends(12, 25), "from (25, 0) to (25, 20) mm (layer BEND)"),
    "short by 0.01": (bends(12, low=0.01, high=19.99), "from (12, 0) to (12, 20) mm (layer BEND)"),
    "diagonal": (diagonal, "from (0, 0) to (40, 20) mm"),
    "arc": (quarter, "from (0, 10) to (10, 0) mm"),
    "split outline": (split_outline, "from (12, 0) to (12, 20) mm"),
    "two closed halves": (two_closed_halves, "from (12, 0) to (12, 20) mm"),
    "flange": (flange_on_a_closed_polyline, "from (28, 0) to (28, 20) mm"),
    "grid": (grid_of_bends, "(layer BEND)"),
    "through a hole": (bend_through_a_hole, "(layer BEND)"),
}


@pytest.mark.parametrize("name", SEAMS)
def test_faces_that_share_an_edge_are_one_and_the_edge_is_named(tmp_path, name):
    draw, sentence = SEAMS[name]
    part = read(dxf(tmp_path, draw))
    assert area(part) == pytest.approx(PLATE_MM2, rel=1e-3)
    assert sentence in notes(part)
    assert "--layer" in notes(part)


def notch_across_an_edge(space, _):
    box(space, (0, 0), (40, 20))
    box(space, (15, 15), (25, 25))


def circle_at_a_corner(space, _):
    lines(space)
    space.add_circle((0, 0), 3)


def plus_of_two_boxes(space, _):
    lines(space, [(0, 10), (40, 10), (40, 20), (0, 20)])
    lines(space, [(15, 0), (25, 0), (25, 30), (15, 30)])


@pytest.mark.parametrize("draw", [notch_across_an_edge, circle_at_a_corner, plus_of_two_boxes])
def test_closed_contours_that_overlap_are_refused(tmp_path, draw):
    with pytest.raises(
        InputError, match=r"closed contours overlap near \(.*draw the outline as one"
    ):
        read(dxf(tmp_path, draw))


def cross_of_centre_lines(space, _):
    box(space, (-12, -9), (12, 9))
    space.add_circle((0, 0), 5)
    for end in ((15, 0), (0, 15)):
        space.add_line(end, np.negative(end), dxfattribs={"layer": "CENTER"})


def touching_holes(space, _):
    box(space, (-12, -9), (12, 9))
    space.add_circle((0, 4), 5)
    space.add_circle((5, -4), 3)


def lead_in(space, _):
    box(space, (-12, -9), (12, 9))
    space.add_circle((0, 0), 5)
    space.add_line((5, 0), (12, 0))


@pytest.mark.parametrize("draw", [cross_of_centre_lines, touching_holes, lead_in])
def test_holes_and_centre_lines_leave_the_outline_as_it_is(tmp_path, draw):
    assert area(read(dxf(tmp_path, draw))) == pytest.approx(24 * 18, rel=1e-3)


def dimension_on(layer, beyond):
    """Extension lines from the plate's corners and a dimension line between them, exploded."""

    def draw(space, _):
        lines(space, layer="CUT")
        attributes = {"layer": layer}
        for x in (0, 40):
            space.add_line((x, 0), (x, -6 - beyond), dxfattribs=attributes)
        space.add_line((0, -6), (40, -6), dxfattribs=attributes)

    return draw


@pytest.mark.parametrize(("layer", "beyond"), [("DIM", 0), ("DIM", 2), ("CUT", 2)])
def test_dimension_lines_that_bound_another_contour_are_refused(tmp_path, layer, beyond):
    path = dxf(tmp_path, dimension_on(layer, beyond))
    with pytest.raises(InputError, match=r"from \(0, .*--layer"):
        read(path)
    if layer == "DIM":
        assert area(read(path, layer="cut")) == pytest.approx(PLATE_MM2)


@pytest.mark.parametrize("seed", range(6))
def test_regions_are_those_of_a_slow_twin(seed):
    """Random lines and boxes: the regions' union is that of the bounded faces by shapely alone."""
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
        edge = shapely.intersection(
            shapely.LinearRing(region.ring), shapely.LinearRing(following.ring)
        )
        assert edge.length < 1e-5


def test_wide_open_outline_about_a_hole_is_refused(tmp_path):
    def draw(space, _):
        space.add_lwpolyline([(0, 0), (40, 0), (40, 20), (0, 20)])  # not closed: 20 mm are missing
        space.add_circle((20, 10), 4)

    with pytest.raises(InputError, match="20 mm away; close it"):
        read(dxf(tmp_path, draw))
