"""Quadrature of the pressure, compared with the moments in closed form; supports on three corners."""

import math
from itertools import combinations

import numpy as np
import pytest
from problems import diameter

from planner.part import outline
from planner.part.pressure import HULL_CORNERS, Pressure, stances, support

SHAPES = {
    "rectangle": [[-15, -10.5], [15, -10.5], [15, 10.5], [-15, 10.5]],
    "triangle": [[0, 0], [36, 0], [0, 26]],
    "L": [[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]],
    "C": [[0, 0], [30, 0], [30, 5], [6, 5], [6, 25], [30, 25], [30, 30], [0, 30]],
    "sliver": [[0, 0], [200, 0], [200, 0.5], [0, 0.5]],
    "curve": [[15 * math.cos(t / 40), 9 * math.sin(t / 40)] for t in range(251)],
}


def second_moments(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.einsum("m,mi,mj->ij", weights, points, points)


@pytest.fixture(params=SHAPES)
def part(request):
    return outline.canonical(SHAPES[request.param]).outline_mm


def test_support_uniform_has_the_moments_of_the_area(part):
    points, weights = support(Pressure("uniform", 100), part)
    size = diameter(part)
    assert np.abs(weights @ points).max() < 1e-13 * size
    assert np.trace(second_moments(points, weights)) == pytest.approx(
        outline.radius_of_gyration(part) ** 2, rel=1e-12
    )


def test_support_boundary_has_the_moments_of_the_edges(part):
    points, weights = support(Pressure("boundary", 100), part)
    ends = np.roll(part, -1, axis=0)
    lengths = np.hypot(*(ends - part).T)
    middles, halves = (part + ends) / 2, (ends - part) / 2
    share = lengths / lengths.sum()
    expected = second_moments(middles, share) + second_moments(halves, share) / 3
    assert weights @ points == pytest.approx(share @ middles, abs=1e-12)
    assert np.allclose(second_moments(points, weights), expected, rtol=1e-12, atol=1e-10)


def test_stances_are_all_corner_triples_that_carry_the_weight(part):
    """A stance is a triple of corners of the convex hull whose loads, by statics, are not negative."""
    feet = stances(part)
    loads = [np.linalg.solve(np.vstack([corners.T, np.ones(3)]), [0, 0, 1]) for corners in feet]
    assert len(feet)
    assert np.min(loads) > -1e-6
    hull = outline.convex_hull(part)
    if len(hull) <= HULL_CORNERS:
        corners = combinations(range(len(hull)), 3)
        every = (np.vstack([hull[list(three)].T, np.ones(3)]) for three in corners)
        assert len(feet) == sum(np.linalg.solve(each, [0, 0, 1]).min() > -1e-6 for each in every)
