"""The width function, against extents measured one by one."""

import math

import numpy as np
import pytest
from problems import OUTLINES, diameter, random_convex, random_star, rectangle, right_triangle

from planner.paper.sensorless import width_function
from planner.part.outline import min_width, width

DIRECTIONS = np.linspace(-4.0, 4.0, 1001)


def outlines():
    rng = np.random.default_rng(0)
    stars = [random_star(rng, int(rng.integers(3, 14))) for _ in range(40)]
    return (
        [make() for make in OUTLINES.values()] + stars + [random_convex(rng, 7) for _ in range(10)]
    )


def test_it_is_the_extent_in_every_direction():
    for outline in outlines():
        expected = [width(outline, direction) for direction in DIRECTIONS]
        assert width_function(outline)(DIRECTIONS) == pytest.approx(expected, abs=1e-9)


def test_the_least_minimum_is_the_narrowest_and_the_greatest_maximum_the_diameter():
    for outline in outlines():
        function = width_function(outline)
        assert function(function.minima).min() == pytest.approx(min_width(outline))
        assert function(function.maxima).max() == pytest.approx(diameter(outline))


def test_extrema_are_higher_or_lower_than_what_is_beside_them():
    for outline in outlines():
        function = width_function(outline)
        for step in (-1e-5, 1e-5):
            assert np.all(function(function.minima) < function(function.minima + step))
            assert np.all(function(function.maxima) > function(function.maxima + step))


def test_textbook_shapes():
    function = width_function(rectangle())
    assert np.degrees(function.minima) == pytest.approx([0.0, 90.0])
    diagonal = math.degrees(math.atan2(21.0, 30.0))
    assert np.degrees(function.maxima) == pytest.approx([diagonal, 180.0 - diagonal])
    # Of a right triangle the legs hold nothing: towards the hypotenuse the width only falls.
    function = width_function(right_triangle())
    assert np.degrees(function.minima) == pytest.approx([math.degrees(math.atan2(36.0, 26.0))])
