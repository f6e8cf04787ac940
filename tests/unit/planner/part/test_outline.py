"""Measures of an outline, compared with closed forms, and polygons that are refused."""

import math
import re

import numpy as np
import pytest
from problems import diameter, turned
from refusals import refused_in_a_line

from planner.part import outline
from planner.part.outline import smallest_rectangle
from runtime.shell.errors import InputError

L_SHAPE = np.array([[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]], dtype=float)
TRIANGLE = np.array([[0, 0], [36, 0], [0, 26]], dtype=float)
RECTANGLE = np.array([[-15, -10.5], [15, -10.5], [15, 10.5], [-15, 10.5]])


@pytest.mark.parametrize("drawn", [L_SHAPE, TRIANGLE, RECTANGLE], ids=["L", "triangle", "box"])
@pytest.mark.parametrize("shift", [(0.0, 0.0), (-7.0, 3.0), (5000.0, -4000.0)])
def test_canonical_is_counter_clockwise_about_the_centroid(drawn, shift):
    for points in (drawn + shift, (drawn + shift)[::-1]):
        result = outline.canonical(points)
        assert outline.area(result.outline_mm) > 0
        assert np.hypot(*outline.centroid(result.outline_mm)) < 1e-11
        assert np.allclose(result.outline_mm[0], points[0] + result.shift_mm, atol=0)
        shifted = points + result.shift_mm + 0.0
        assert {*map(tuple, result.outline_mm)} == {*map(tuple, shifted)}
        assert not result.outline_mm.flags.writeable


def test_area_and_centroid_of_an_l_equal_those_of_its_two_boxes():
    area = 32 * 12 + 12 * 14
    centroid = (np.array([16, 6]) * 32 * 12 + np.array([6, 19]) * 12 * 14) / area
    assert outline.area(L_SHAPE) == area
    assert outline.area(L_SHAPE[::-1]) == -area
    assert np.allclose(outline.centroid(L_SHAPE), centroid, rtol=1e-15)


def test_radius_of_gyration_matches_closed_forms_and_the_published_value():
    by_hand = math.sqrt((30**2 + 21**2) / 12)
    assert outline.radius_of_gyration(RECTANGLE) == pytest.approx(by_hand, rel=1e-14)
    # The authors' released mechanics use this rho for the 30 x 21 mm rectangle.
    assert outline.radius_of_gyration(RECTANGLE) == pytest.approx(10.5711873, abs=1e-7)
    angles = np.linspace(0, math.tau, 720, endpoint=False)
    disc = 20 * np.column_stack([np.cos(angles), np.sin(angles)])
    assert outline.radius_of_gyration(disc) == pytest.approx(20 / math.sqrt(2), rel=1e-4)


def test_min_width_is_the_least_of_all_widths():
    assert outline.min_width(RECTANGLE) == pytest.approx(21.0)
    # The least height of a triangle is that on its longest side.
    assert outline.min_width(TRIANGLE) == pytest.approx(36 * 26 / math.hypot(36, 26))
    for points in (L_SHAPE, TRIANGLE, RECTANGLE):
        widths = [outline.width(points, angle) for angle in np.linspace(0, math.pi, 3601)]
        least = outline.min_width(points)
        assert least <= min(widths) + 1e-12
        assert least == pytest.approx(min(widths), abs=diameter(points) * math.pi / 3600)
        assert diameter(points) == pytest.approx(max(widths), rel=1e-5)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        ([[0, 0], [10, 10], [10, 0], [0, 10]], "crosses itself at (5, 5)"),
        ([[0, 0], [4, 0], [4, 4], [2, 0], [0, 4]], "touches itself at (2, 0)"),
        ([[0, 0], [1, 1], [2, 2], [5, 5]], "lie on one line"),
        ([[0, 0], [1, 0]], "has 2 vertices; give at least 3"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0]], "not a list of [x, y] pairs"),
        ([[0, 0], [1, 0], [math.nan, 1]], "vertex 3 is not finite"),
        (
            [[0, 0], [1, 0], [1, 1], [0, 0]],
            "vertices 1 and 4 are the same point (0, 0); drop the last one",
        ),
        ([[0, 0], [1, 0], [1, 0], [1, 1]], "vertices 2 and 3 are the same point (1, 0); drop one"),
    ],
)
def test_canonical_not_a_simple_polygon_is_refused(points, words):
    with refused_in_a_line(InputError, re.escape(words)):
        outline.canonical(points)


@pytest.mark.parametrize("degrees", [0, 12, 45, 89, 90, -30])
def test_smallest_rectangle_turned_box_returns_its_size_and_turn(degrees):
    result = smallest_rectangle(turned([(0, 0), (42, 0), (42, 26), (0, 26)], math.radians(degrees)))
    assert (result.length_mm, result.width_mm) == pytest.approx((42.0, 26.0))
    assert (result.turn_deg - degrees + 90.0) % 180.0 == pytest.approx(90.0, abs=1e-6)
    assert ("turned" in result.text()) is (degrees % 90 != 0)


def test_smallest_rectangle_has_the_least_area_of_all_angles():
    rng = np.random.default_rng(3)
    points = rng.normal(size=(12, 2)) * (20.0, 9.0)
    result = smallest_rectangle(points)
    least = min(
        np.prod(np.ptp(turned(points, angle), axis=0))
        for angle in np.radians(np.arange(0.0, 90.0, 0.5))
    )
    assert result.length_mm * result.width_mm <= least + 1e-9
