"""Rotational order of outlines whose symmetry is known."""

import math

import numpy as np
import pytest
import shapely

from planner.part import outline, symmetry


def ring(n: int, rx: float, ry: float | None = None) -> np.ndarray:
    angles = np.arange(n) * math.tau / n
    return np.column_stack([rx * np.cos(angles), (rx if ry is None else ry) * np.sin(angles)])


def star(points: int, inner: float, outer: float) -> np.ndarray:
    angles = np.arange(2 * points) * math.pi / points
    radii = np.where(np.arange(2 * points) % 2, inner, outer)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


RECTANGLE = np.array([[-15, -10.5], [15, -10.5], [15, 10.5], [-15, 10.5]])
KNOWN = {
    "rectangle": (RECTANGLE, 2),
    "square": (ring(4, 20), 4),
    "equilateral triangle": (ring(3, 20), 3),
    "right triangle": ([[0, 0], [36, 0], [0, 26]], 1),
    "isosceles triangle": ([[-14, 0], [14, 0], [0, 34]], 1),
    "L": ([[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]], 1),
    "parallelogram": ([[0, 0], [30, 0], [40, 15], [10, 15]], 2),
    "hexagon": (ring(6, 15), 6),
    "five-pointed star": (star(5, 8, 20), 5),
    "ellipse": (ring(96, 18, 11), 2),
    "nearly round ellipse": (ring(240, 15, 14.8), 2),
    "disc": (ring(90, 15), 90),
}


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("angle", [0.0, 0.5])
def test_order_of_known_shapes_at_any_angle(name, angle):
    points, expected = KNOWN[name]
    c, s = math.cos(angle), math.sin(angle)
    part = outline.canonical(
        np.asarray(points) @ np.array([[c, s], [-s, c]]) + [4.0, -1.0]
    ).outline_mm
    assert symmetry.order(part) == expected
    for n in range(1, expected + 1):
        if expected % n == 0:
            assert symmetry.has_order(part, n)


def test_tolerance_decides_how_square_a_square_must_be():
    for excess, expected in ((0.01, 4), (0.1, 2)):
        part = RECTANGLE * [1.0, (30 + excess) / 21]
        assert symmetry.order(part) == expected
        assert symmetry.order(part, tolerance_mm=0.2) == 4


def test_a_curve_that_was_simplified_keeps_its_symmetry():
    """Each round end of a key keeps vertices of its own."""
    key = shapely.LineString([[-9.0, 0.0], [9.0, 0.0]]).buffer(3.0, quad_segs=16)
    drawn = outline.canonical(shapely.get_coordinates(key.exterior)[:-1]).outline_mm
    part = outline.canonical(outline.simplified(drawn, 0.05)).outline_mm
    assert len(part) % 2
    assert symmetry.order(part) == 2
    assert symmetry.order(part, tolerance_mm=0.02) == 1


@pytest.mark.parametrize("name", KNOWN)
def test_has_order_of_few_vertices_first_is_that_of_all_turns_of_all_vertices(name):
    part = outline.canonical(np.asarray(KNOWN[name][0])).outline_mm
    boundary = shapely.LinearRing(part)

    def whole(n: int) -> bool:
        angles = math.tau * np.arange(1, n) / n
        turned = [
            part @ np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]])
            for a in angles
        ]
        return all(
            bool((shapely.distance(boundary, shapely.points(each)) <= 0.05).all())
            for each in turned
        )

    for n in (2, 3, 4, 5, 6, 9):
        assert symmetry.has_order(part, n) == whole(n)


def test_order_of_a_disc_of_many_vertices_is_what_a_table_can_state():
    assert symmetry.order(ring(2000, 20.0)) == symmetry.MOST_ORDER
    assert symmetry.order(ring(2000, 20.0, 12.0)) == 2
