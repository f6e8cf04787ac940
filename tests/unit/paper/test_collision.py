"""The collision detector against polygons: its teacher against shapely, and both kinds of error."""

import math

import numpy as np
import problems
import pytest
import shapely

from planner.learned.region import stands_on
from planner.paper.collision import CollisionDetector, Confusion, exact, from_finger, placements
from planner.part import symmetry

RADIUS = 38.25
HELD_OUT = 100_000


@pytest.fixture(scope="module", params=["rectangle", "L"])
def case(request):
    outline = problems.OUTLINES[request.param]()
    order = symmetry.order(outline)
    rng = np.random.default_rng(7)
    return outline, CollisionDetector.fit(outline, problems.JAWS, order, RADIUS, rng)


def drawn(outline, n, seed, any_opening=True):
    return placements(outline, problems.JAWS, RADIUS, n, np.random.default_rng(seed), any_opening)


@pytest.mark.parametrize("name", ["rectangle", "butterfly", "L", "bar 60 x 12"])
def test_the_exact_test_agrees_with_shapely_at_any_opening(name):
    outline = problems.OUTLINES[name]()
    poses, opening = drawn(outline, 400, 1)
    hits = exact(outline, 27.5, 9.5, poses, opening)
    for pose, width, hit in zip(poses, opening, hits, strict=True):
        part = shapely.Polygon(problems.place(outline, pose))
        area = sum(part.intersection(problems.finger_box(f, f * width / 2)).area for f in (1, -1))
        assert hit == (area > 0.0) or area < 1e-6


def test_the_exact_test_is_that_of_the_roll_outs_at_full_opening():
    outline = problems.l_shape()
    poses, opening = drawn(outline, 20_000, 2, any_opening=False)
    hits = exact(outline, 27.5, 9.5, poses, opening)
    assert np.array_equal(hits, stands_on(outline, problems.JAWS, poses))
    assert 0.05 < hits.mean() < 0.5


def test_the_lower_finger_is_the_upper_one_of_a_hand_turned_by_half_a_turn():
    poses, opening = drawn(problems.l_shape(), 100, 3)
    turned = poses * [-1.0, -1.0, 1.0] + [0.0, 0.0, math.pi]
    assert np.allclose(from_finger(poses, opening, -1), from_finger(turned, opening, 1))


@pytest.mark.parametrize("any_opening", [True, False])
def test_hardly_any_colliding_placement_passes_and_few_free_ones_are_lost(case, any_opening):
    outline, detector = case
    confusion = detector.judged(outline, *drawn(outline, HELD_OUT, 4, any_opening))
    assert confusion.free + confusion.colliding == HELD_OUT
    assert confusion.colliding > 10_000
    assert confusion.miss_rate <= 0.001
    assert confusion.false_alarm_rate < 0.08


def test_what_is_missed_hardly_touches(case):
    outline, detector = case
    poses, opening = drawn(outline, HELD_OUT, 5)
    hits = exact(outline, 27.5, 9.5, poses, opening)
    missed = hits & ~detector.collides(poses, opening)
    # A finger smaller by 1 mm on every side would not have touched.
    smaller = exact(outline, 25.5, 7.5, poses[missed], opening[missed] + 2.0)
    assert np.count_nonzero(smaller) <= 1e-4 * np.count_nonzero(hits)


def test_parts_out_of_reach_are_free_and_parts_under_a_finger_are_not(case):
    _, detector = case
    away = np.array([[60.0, 0.0, 0.4], [0.0, 80.0, 1.0], [-45.0, -45.0, 2.0]])
    assert not np.any(detector.collides(away, 85.0))
    under = np.array([[0.0, 47.0, 0.4], [5.0, -47.0, 1.0]])
    assert np.all(detector.collides(under, 85.0))
    assert np.all(detector.collides(np.zeros((2, 3)), np.array([2.0, 5.0])))


def test_an_opening_is_one_for_all_or_one_for_each(case):
    _, detector = case
    poses, _ = drawn(problems.rectangle(), 500, 6)
    each = detector.collides(poses, np.full(500, 40.0))
    assert np.array_equal(detector.collides(poses, 40.0), each)


def test_rates_of_nothing_are_nothing():
    assert Confusion(0, 0, 0, 0).miss_rate == 0.0
    assert Confusion(8, 4, 2, 1) == (8, 4, 2, 1)
    assert Confusion(8, 4, 2, 1).false_alarm_rate == 0.25
    assert Confusion(8, 4, 2, 1).miss_rate == 0.25


def test_same_seed_gives_the_same_detector():
    outline = problems.hexagon()
    first, second = (
        CollisionDetector.fit(outline, problems.JAWS, 6, 38.25, np.random.default_rng(1), samples=5000)
        for _ in range(2)
    )
    assert first.threshold == second.threshold
    assert all(np.array_equal(a, b) for a, b in zip(first.tree, second.tree, strict=True))
