"""The rotational order of outlines whose symmetry is known."""

import math

import numpy as np
import pytest
import shapely
from problems import l_shape, place, rectangle, regular_polygon, right_triangle, turned

from planner.part import outline, symmetry


def star(points: int, inner: float, outer: float) -> np.ndarray:
    angles = np.arange(2 * points) * math.pi / points
    radii = np.where(np.arange(2 * points) % 2, inner, outer)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


KNOWN = {
    "rectangle": (rectangle(), 2),
    "square": (regular_polygon(4, 20.0), 4),
    "equilateral triangle": (regular_polygon(3, 20.0), 3),
    "right triangle": (right_triangle(), 1),
    "isosceles triangle": ([[-14, 0], [14, 0], [0, 34]], 1),
    "L": (l_shape(), 1),
    "parallelogram": ([[0, 0], [30, 0], [40, 15], [10, 15]], 2),
    "hexagon": (regular_polygon(6, 15.0), 6),
    "five-pointed star": (star(5, 8, 20), 5),
    "ellipse": (regular_polygon(96, 1.0) * [18.0, 11.0], 2),
    "nearly round ellipse": (regular_polygon(240, 1.0) * [15.0, 14.8], 2),
    "disc": (regular_polygon(90, 15.0), 90),
}


@pytest.mark.parametrize(("points", "expected"), KNOWN.values(), ids=KNOWN)
@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_order_known_shape_at_any_angle_equals_its_symmetry(points, expected, angle):
    part = outline.canonical(place(points, [4.0, -1.0, angle])).outline_mm
    assert symmetry.order(part) == expected
    for n in range(1, expected + 1):
        if expected % n == 0:
            assert symmetry.has_order(part, n)


def test_order_nearly_square_depends_on_the_tolerance():
    for excess, expected in ((0.01, 4), (0.1, 2)):
        part = rectangle() * [1.0, (30 + excess) / 21]
        assert symmetry.order(part) == expected
        assert symmetry.order(part, tolerance_mm=0.2) == 4


def test_order_simplified_curve_keeps_its_symmetry():
    """Simplification keeps different vertices at the two round ends of a key."""
    key = shapely.LineString([[-9.0, 0.0], [9.0, 0.0]]).buffer(3.0, quad_segs=16)
    drawn = outline.canonical(shapely.get_coordinates(key.exterior)[:-1]).outline_mm
    part = outline.canonical(outline.simplified(drawn, 0.05)).outline_mm
    assert len(part) % 2
    assert symmetry.order(part) == 2
    assert symmetry.order(part, tolerance_mm=0.02) == 1


@pytest.mark.parametrize("name", KNOWN)
def test_has_order_equals_the_check_of_all_turns_and_vertices(name):
    part = outline.canonical(np.asarray(KNOWN[name][0])).outline_mm
    boundary = shapely.LinearRing(part)

    def whole(n: int) -> bool:
        every = [shapely.points(turned(part, math.tau * k / n)) for k in range(1, n)]
        return all((shapely.distance(boundary, each) <= 0.05).all() for each in every)

    for n in (2, 3, 4, 5, 6, 9):
        assert symmetry.has_order(part, n) == whole(n)


def test_order_disc_of_many_vertices_is_most_order():
    disc = regular_polygon(2000, 20.0)
    assert symmetry.order(disc) == symmetry.MOST_ORDER
    assert symmetry.order(disc * [1.0, 0.6]) == 2
