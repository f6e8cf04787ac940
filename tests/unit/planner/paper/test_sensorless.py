"""Goldberg's squeeze function and plans: his theorems, and the simulator where his assumptions hold."""

import math

import numpy as np
import problems
import pytest

from planner.paper.sensorless import SqueezeFunction, plan, width_function
from planner.part.outline import convex_hull, min_width, width

pytestmark = pytest.mark.slow


def outlines():
    rng = np.random.default_rng(1)
    stars = [problems.random_star(rng, int(rng.integers(3, 14))) for _ in range(60)]
    return [make() for make in problems.OUTLINES.values()] + stars


def carried_out(outline, angles, rng):
    """Final angles, in the world frame, of 300 random parts after squeezes at the hand angles `angles`.

    Each squeeze is Goldberg's squeeze function; the simulator is not used.
    """
    function = SqueezeFunction.of(outline)
    theta = rng.uniform(-4.0, 4.0, 300)
    for angle in angles:
        theta = angle + 0.5 * math.pi - function(angle + 0.5 * math.pi - theta)
    return theta


def off(outline, result, angles, rng):
    """The largest error of the plan's final angle, over random parts that are squeezed at `angles`."""
    return apart(carried_out(outline, angles, rng) - result.final, result.period).max()


def apart(angles, period):
    return np.abs(angles - period * np.round(angles / period))


def test_squeeze_function_is_a_rising_staircase():
    for outline in outlines():
        function = SqueezeFunction.of(outline)
        direction = np.linspace(-5.0, 5.0, 4001)
        after = function(direction)
        assert np.all(np.diff(after) >= -1e-12)
        assert np.all(np.abs(after - direction) < math.pi)
        assert function(after) == pytest.approx(after)
        assert function(direction + function.period) == pytest.approx(after + function.period)


def test_plan_orients_any_part_up_to_the_symmetry_of_its_hull():
    rng = np.random.default_rng(2)
    for outline in outlines():
        result = plan(outline)
        assert off(outline, result, result.angles, rng) < 1e-9
        assert len(result.angles) <= 2 * len(convex_hull(outline)) - 1  # Goldberg's bound


def test_plan_with_hand_errors_below_its_slack_still_orients():
    rng = np.random.default_rng(3)
    for outline in outlines()[:30]:
        result = plan(outline)
        errors = 0.98 * result.slack * rng.uniform(-0.5, 0.5, len(result.angles))
        errors[-1] = 0.0
        if len(result.angles) > 1:
            assert off(outline, result, result.angles + errors, rng) < 1e-9


@pytest.mark.parametrize(
    ("outline", "degrees"),
    [
        (problems.rectangle(), 180),
        (problems.hexagon(), 60),
        (problems.regular_polygon(4, 14.0), 90),
        (problems.regular_polygon(5, 14.0), 36),
        (problems.right_triangle(), 180),
        (problems.disc(), 180),
    ],
)
def test_squeeze_function_of_known_shape_has_its_period(outline, degrees):
    assert math.degrees(SqueezeFunction.of(outline).period) == pytest.approx(degrees)


def scalene():
    """A random polygon without an edge that is square to a line between two vertices.

    So every equilibrium of a squeeze is clearly stable or unstable.
    """
    return problems.random_convex(np.random.default_rng(6), 5)


@pytest.mark.parametrize(
    "make", [problems.rectangle, scalene, problems.hexagon, problems.l_shape, problems.bar]
)
def test_roll_out_without_friction_ends_at_local_minima_of_width(make):
    outline, rng = make(), np.random.default_rng(4)
    model = problems.simulator(outline, jaws=problems.LONG_JAWS)
    frictionless = model.sample(400, rng)._replace(mu=np.zeros((400, 2)))
    final = model.roll_out(problems.random_poses(rng, 400, 5.0), frictionless)
    minima = width_function(outline).minima
    direction = 0.5 * math.pi - final.poses[:, 2]
    beside = apart(direction[:, None] - minima[None], math.pi).min(axis=1)
    assert np.mean(np.degrees(beside) < 0.5) > 0.99
    assert final.width_mm == pytest.approx(width_function(outline)(direction), abs=0.05)


DIRECTIONS = np.linspace(-4.0, 4.0, 1001)


def test_width_function_equals_the_extent_in_any_direction():
    for outline in outlines():
        expected = [width(outline, direction) for direction in DIRECTIONS]
        assert width_function(outline)(DIRECTIONS) == pytest.approx(expected, abs=1e-9)


def test_width_function_extrema_are_strict_and_include_the_bounds():
    for outline in outlines():
        function = width_function(outline)
        assert function(function.minima).min() == pytest.approx(min_width(outline))
        assert function(function.maxima).max() == pytest.approx(problems.diameter(outline))
        for step in (-1e-5, 1e-5):
            assert np.all(function(function.minima) < function(function.minima + step))
            assert np.all(function(function.maxima) > function(function.maxima + step))


def test_width_function_of_textbook_shapes_has_known_extrema():
    function = width_function(problems.rectangle())
    assert np.degrees(function.minima) == pytest.approx([0.0, 90.0])
    diagonal = math.degrees(math.atan2(21.0, 30.0))
    assert np.degrees(function.maxima) == pytest.approx([diagonal, 180.0 - diagonal])
    # The legs of a right triangle are no minima: the width falls on towards the hypotenuse.
    function = width_function(problems.right_triangle())
    assert np.degrees(function.minima) == pytest.approx([math.degrees(math.atan2(36.0, 26.0))])
