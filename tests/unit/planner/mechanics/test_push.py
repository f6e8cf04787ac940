"""Pushes with known results, and their invariance under turning and mirroring of the scene."""

import math

import numpy as np
import push_twin
import pytest
import shapely
from problems import (
    JAWS,
    hexagon,
    l_shape,
    place,
    random_convex,
    rectangle,
    regular_polygon,
    right_triangle,
    simulator,
    turned,
)
from push_paths import paths, random_paths
from twin import Part

from planner.arrays import take
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.push import SLID, STUCK, Paths
from planner.mechanics.simulator import commanded


def pushed(outline, built, mu, **options):
    part = simulator(outline, **options)
    result = part.push(built, part.nominal(len(built.angles), mu))
    assert not result.given_up.any()
    return result


def test_push_through_the_centre_carries_the_part_along():
    pushes = paths([(-5.0, -11.5), (5.0, -11.5)], shift=(0.0, 20.0))
    for mu in (0.0, 0.5):
        result = pushed(rectangle(), pushes, mu)
        assert result.moved[0] == pytest.approx([0.0, 19.0, 0.0], abs=1e-6)  # 1 mm to contact
        assert result.status[0] == STUCK


def test_push_disc_by_frictionless_point_follows_the_closed_form():
    """The form is d(phi)/ds = sin(phi) / R; phi is the angle from the push to the direction of the centre."""
    radius, way = 13.0, 6.0
    outline = regular_polygon(720, radius)
    for degrees in (10.0, 30.0, 50.0):
        phi = math.radians(degrees)
        start = -radius * np.array([math.cos(phi), math.sin(phi)])
        result = pushed(outline, paths([start], shift=(way, 0.0)), 0.0)
        end = 2.0 * math.atan(math.tan(phi / 2.0) * math.exp(way / radius))
        expected = start + [way, 0.0] + radius * np.array([math.cos(end), math.sin(end)])
        assert result.moved[0, :2] == pytest.approx(expected, abs=0.05)
        assert abs(result.moved[0, 2]) < math.radians(0.5)
        assert result.status[0] == (STUCK if np.hypot(*(expected - [way, 0.0])) < 10.0 else SLID)


def test_push_part_in_a_cage_turns_about_the_pusher_centre():
    cage = [(-15.0, 3.0), (15.0, -3.0), (4.0, 10.5), (-4.0, -10.5), (-15.0, -3.0), (15.0, 3.0)]
    result = pushed(rectangle(), paths(cage, angle=1.0), 0.8)
    assert result.moved[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.02)
    assert result.status[0] == STUCK


@pytest.mark.parametrize("angle", [0.3, -0.3])
def test_push_sticking_fingers_move_the_part_as_commanded(angle):
    """The hand turns about a point so far to the side that the forces lie well within the friction cones."""
    centre = (math.copysign(90.0, -angle), 0.0)
    pushes = paths([(-8.0, -10.5), (8.0, -10.5)], centre=centre, angle=angle)
    result = pushed(rectangle(), pushes, 1.0)
    assert result.moved == pytest.approx(commanded(pushes), abs=1e-6)
    assert result.status[0] == STUCK


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_push_turned_scene_ends_turned(mu):
    outline, angle = random_convex(np.random.default_rng(5), 6), 0.7
    pushes = random_paths(outline, np.random.default_rng(6), 40)
    other = Paths(*(turned(values, angle) if values.ndim > 1 else values for values in pushes))
    surface = simulator(outline).surface
    turn = np.eye(3)
    turn[:2, :2] = turned(np.eye(2), angle).T
    straight = pushed(outline, pushes, mu, surface=surface)
    result = pushed(
        turned(outline, angle),
        other,
        mu,
        surface=LimitSurface(turn @ surface.A @ turn.T, surface.rho_mm),
    )
    assert result.moved[:, :2] == pytest.approx(turned(straight.moved[:, :2], angle), abs=1e-6)
    assert result.moved[:, 2] == pytest.approx(straight.moved[:, 2], abs=1e-7)


@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_push_mirrored_scene_ends_mirrored(mu):
    """The rectangle and its limit surface equal their mirror images."""
    pushes = random_paths(rectangle(), np.random.default_rng(7), 40)
    flip = np.array([-1.0, 1.0])
    other = Paths(pushes.points * flip, pushes.centres * flip, -pushes.angles, pushes.shifts * flip)
    straight, result = pushed(rectangle(), pushes, mu), pushed(rectangle(), other, mu)
    assert result.moved == pytest.approx(straight.moved * [-1.0, 1.0, -1.0], abs=1e-6)


def test_push_disc_by_round_tip_follows_the_closed_form():
    """The disc moves as if pushed by a point, but the sum of both radii takes the place of its radius."""
    radius, tip, way, phi = 13.0, 4.75, 6.0, math.radians(30.0)
    along = np.array([math.cos(phi), math.sin(phi)])
    part = simulator(regular_polygon(720, radius))
    pushes = paths([-(radius + tip) * along], shift=(way, 0.0))
    result = part.push(pushes, part.nominal(1, 0.0), tip)
    end = 2.0 * math.atan(math.tan(phi / 2.0) * math.exp(way / (radius + tip)))
    expected = (radius + tip) * (np.array([math.cos(end), math.sin(end)]) - along) + [way, 0.0]
    assert result.moved[0, :2] == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("mu", [0.1, 0.4])
@pytest.mark.parametrize("outline", [right_triangle(), rectangle()])
def test_push_by_round_tip_ends_where_the_twin_does(outline, mu):
    rng, tip = np.random.default_rng(5), 4.75
    part = simulator(outline)
    twin = Part(np.asarray(part.outline), part.surface.A, part.surface.rho_mm, mu, JAWS)
    pushes = beside(outline, rng, tip)
    moved = part.push(pushes, part.nominal(1, mu), tip).moved[0]
    reference = push_twin.push(
        twin, pushes.points[0], pushes.centres[0], 0.0, pushes.shifts[0], tip
    )
    assert moved == pytest.approx(reference, abs=0.1)
    assert np.abs(moved[:2]).max() > 1.0


def beside(outline, rng, tip):
    """A random path of a round tip that touches an outline near a vertex and may slide past this vertex."""
    k = rng.integers(len(outline))
    start, end = outline[k], outline[(k + 1) % len(outline)]
    edge = (end - start) / math.hypot(*(end - start))
    inward = np.array([-edge[1], edge[0]])
    place = start + rng.uniform(0.05, 0.2) * (end - start) - (tip + 0.01) * inward
    return paths([place], shift=12.0 * inward + rng.uniform(-6.0, 6.0) * edge)


def test_push_by_round_tip_never_ends_inside_the_part():
    """The whole disc of the tip stays outside: past vertices, along edges and at concave outlines."""
    rng, tip = np.random.default_rng(8), 4.75
    for outline in (l_shape(), hexagon(), right_triangle()):
        part, ring = simulator(outline), shapely.Polygon(outline).buffer(tip + 0.01).exterior
        starts = shapely.get_coordinates(
            shapely.line_interpolate_point(ring, rng.uniform(0.0, ring.length, 60))
        )
        ways = -starts + rng.uniform(-8.0, 8.0, (60, 2))
        pushes = Paths(starts[:, None], starts, np.zeros(60), 0.6 * ways)
        result = part.push(pushes, part.nominal(60, 0.3), tip)
        assert not result.given_up.any()
        for start, way, moved in zip(starts, pushes.shifts, result.moved, strict=True):
            end = shapely.Polygon(place(outline, moved))
            assert end.distance(shapely.Point(start + way)) > tip - 0.03


def test_push_by_hand_before_a_wide_part_equals_push_by_corners():
    """The part is so much wider than the hand that only the four front corners of the fingers touch it."""
    plate, opening, way, n = rectangle() * 8.0, 30.0, 25.0, 20
    part, rng = simulator(plate), np.random.default_rng(5)
    poses = np.column_stack(
        [np.full(n, JAWS.length_mm / 2 + 150.0), rng.uniform(-20, 20, n), rng.uniform(-0.2, 0.2, n)]
    )
    drawn = part.sample(n, np.random.default_rng(9))
    ways = np.full(n, opening), np.full(n, way)
    by_hand = part.push_by_hand(poses, *ways, np.random.default_rng(9))
    for k, pose in enumerate(poses):
        far = (15.0, 15.0 + JAWS.thickness_mm)
        ahead = np.array([(JAWS.length_mm / 2, side * y) for side in (-1, 1) for y in far])
        back = turned(ahead - pose[:2], -pose[2])
        push = paths(back, shift=turned([way, 0.0], -pose[2]))
        result = part.push(push, take(drawn, np.array([k])))
        moved = [*turned(result.moved[0, :2], pose[2]), result.moved[0, 2]]
        assert by_hand[k] == pytest.approx(pose + moved, abs=0.05)


@pytest.mark.parametrize("share", [0.5, 0.6, 1.0])
def test_push_by_hand_uneven_fingers_push_beside_the_middle(share):
    """A part midway between the fingers is pushed straight ahead, although one finger has closed farther."""
    part, opening = simulator(rectangle(), JAWS._replace(upper_share=share)), 20.0
    upper = 0.5 * JAWS.opening_mm - share * 65.0
    lower = -0.5 * JAWS.opening_mm + (1.0 - share) * 65.0
    start = np.array([[JAWS.length_mm / 2 + 16.0, 0.5 * (upper + lower), 0.0]])
    end = part.push_by_hand(start, np.array([opening]), np.array([20.0]), np.random.default_rng(0))
    assert end[0] == pytest.approx(start[0] + [19.0, 0.0, 0.0], abs=0.02)
