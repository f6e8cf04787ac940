"""Whole squeezes with a known result: jams, pushes, symmetries, statuses, determinism."""

import math
from dataclasses import replace

import numpy as np
import pytest
from problems import (
    JAWS,
    LONG_JAWS,
    OUTLINES,
    l_shape,
    place,
    random_convex,
    random_poses,
    rectangle,
    simulator,
    sliver,
)

from planner.mechanics.clearance import Jaws
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.simulator import STATUS_NAMES
from planner.part.outline import width

DIAGONAL = math.atan2(10.5, 15.0)
"""Angle of the rectangle's diagonal to its long side."""


def squeeze(simulator, poses, mu=0.5):
    """Squeezes parts at nominal parameters; returns final poses, widths and names of the statuses."""
    poses = np.atleast_2d(np.asarray(poses, float))
    result = simulator.roll_out(poses, simulator.nominal(len(poses), mu))
    return result.poses, result.width_mm, [STATUS_NAMES[s] for s in result.status]


def tilted(off_axis_deg):
    """Pose of the centred rectangle whose diagonal is `off_axis_deg` from the closing axis."""
    return [0.0, 0.0, math.pi / 2 - DIAGONAL + math.radians(off_axis_deg)]


# Jams.


def test_squeeze_finger_in_a_notch_moves_the_part_until_both_touch():
    """A finger wedged between two lugs does not hold the part alone; it pushes the part on."""
    half = [(16.25, 3.375), (11.5, 3.375), (11.5, 3.05), (8.5, 3.05), (8.5, 2.5)]
    half += [(-x, y) for x, y in reversed(half)]
    lugs = np.array([*half, *((-x, -y) for x, y in half)])
    poses = np.random.default_rng(1).uniform((-2.4, 7.5, 0.01), (-1.9, 9.0, 0.06), (500, 3))
    rig = simulator(lugs, JAWS)
    ended = rig.roll_out(poses, rig.nominal(len(poses), 1.3))
    whole = ended.given_up == 0
    assert whole.mean() > 0.99
    for pose, width_mm in zip(ended.poses[whole], ended.width_mm[whole], strict=True):
        lowest_mm = place(lugs, pose)[:, 1].min()
        assert lowest_mm < -0.5 * width_mm + 0.01, "the lower finger touches nothing"


def test_squeeze_finger_corner_between_two_teeth_carries_the_part_to_the_other_finger():
    """A finger's corner between two teeth is far behind some of their edges, but does not count as inside."""
    right = [(19.0, -3.6), (19.0, -2.7), (18.0, -2.7), (18.0, -1.7), (19.0, -1.7), (19.0, -0.8)]
    right += [(18.0, -0.8), (18.0, 3.7)]
    comb = np.array([*right, *((-x, y) for x, y in reversed(right))])
    corner_mm = 0.5 * JAWS.length_mm
    low, high = (-corner_mm - 4.0, -12.0, 1.53), (-corner_mm - 1.0, -2.0, 1.62)
    poses = np.random.default_rng(2).uniform(low, high, (1000, 3))
    rig = simulator(comb, JAWS, step_mm=0.8)
    ended = rig.roll_out(poses, rig.nominal(len(poses), 0.3))
    assert ended.given_up.mean() < 0.005
    names = np.array(STATUS_NAMES)[ended.status]
    held = np.isin(names, ("grasped", "jammed")) & (ended.given_up == 0)
    assert held.sum() > 200
    assert ended.width_mm[held].max() < 38.8, "wider than the part is long"


def test_squeeze_finger_in_a_shoulder_corner_is_rarely_given_up():
    """A finger's corner that is slightly inside the shaft still pushes on the shoulder beside the shaft."""
    shaft = [(-11.5, -3.5), (-5.5, -3.5), (-5.5, -2.0), (38.5, -2.0)]
    head = [(-11.5, 8.45), (-20.8, 8.45), (-20.8, -8.45), (-11.5, -8.45)]
    stepped = np.array([*head, *shaft, *((x, -y) for x, y in reversed(shaft))])
    rig = simulator(stepped, Jaws(140.0, 27.0, 13.5, 0.5))
    rng = np.random.default_rng(1)
    poses = rng.uniform((15.1, -40.0, -1.539055), (15.3, -27.0, -1.539040), (3000, 3))
    ended = rig.roll_out(poses, rig.sample(len(poses), rng))
    assert ended.given_up.mean() < 0.002


@pytest.mark.parametrize("mu", [0.1, 0.3, 0.65])
@pytest.mark.parametrize("side", [1, -1])
def test_squeeze_rectangle_jams_on_its_diagonal_up_to_atan_mu(mu, side):
    """Up to atan(mu) off the closing axis the part jams where it lies; beyond, it turns until flush."""
    limit = math.degrees(math.atan(mu))
    inside, outside = tilted(side * (limit - 0.2)), tilted(side * (limit + 0.2))
    poses, widths, statuses = squeeze(simulator(rectangle(), LONG_JAWS), [inside, outside], mu)
    assert statuses[0] == "jammed"
    assert np.allclose(poses[0], inside, atol=1e-9)
    expected = 2 * math.hypot(15.0, 10.5) * math.cos(math.radians(limit - 0.2))
    assert widths[0] == pytest.approx(expected, abs=1e-6)
    assert abs(poses[1, 2] - outside[2]) > 0.02
    assert widths[1] < widths[0] - 0.1


def test_squeeze_turning_rectangle_jams_only_within_atan_mu():
    """From any initial pose, a part that jams has its diagonal within atan(mu) of the axis."""
    poses = random_poses(np.random.default_rng(1), 300, 10.0)
    final, widths, statuses = squeeze(simulator(rectangle(), LONG_JAWS), poses, 0.3)
    jammed = np.array(statuses) == "jammed"
    off = np.degrees(np.arccos(np.clip(widths[jammed] / (2 * math.hypot(15.0, 10.5)), -1, 1)))
    assert jammed.sum() > 10
    assert off.max() <= math.degrees(math.atan(0.3)) + 0.2
    flush = np.abs((final[~jammed, 2] + math.pi / 4) % (math.pi / 2) - math.pi / 4)
    assert np.degrees(flush).max() < 0.2


# Frictionless jaws: Goldberg's squeeze function.


@pytest.mark.parametrize("seed", range(6))
def test_squeeze_without_friction_ends_at_a_local_minimum_width(seed):
    """Goldberg, Orienting polygonal parts without sensors (1993): the width falls until the part is flush."""
    rng = np.random.default_rng(seed)
    outline = random_convex(rng, int(rng.integers(4, 9)))
    part, placed = simulator(outline, LONG_JAWS), random_poses(rng, 10, 10.0)
    poses, widths, statuses = squeeze(part, placed, mu=0.0)
    assert set(statuses) == {"grasped"}
    for pose, final_width in zip(poses, widths, strict=True):
        axis = math.pi / 2 - pose[2]  # the closing axis, seen from the part
        assert final_width == pytest.approx(width(outline, axis), abs=0.02)
        nearby = axis + np.radians([-0.5, 0.5])
        assert min(width(outline, angle) for angle in nearby) > final_width - 0.02
        assert lowest_nearby(outline, axis) == pytest.approx(final_width, abs=0.02)


def lowest_nearby(outline, axis):
    """The least width of an outline within one degree of an axis."""
    return min(width(outline, axis + math.radians(d)) for d in np.linspace(-1.0, 1.0, 201))


# Symmetries.

MIRROR = np.array([-1.0, 1.0, -1.0])


def mirrored(part):
    """The part with its outline and limit surface mirrored at the closing axis."""
    surface = LimitSurface(part.surface.A * np.outer(MIRROR, MIRROR), part.surface.rho_mm)
    outline = np.ascontiguousarray((part.outline * [-1, 1])[::-1])
    return replace(part, outline=outline, surface=surface)


@pytest.mark.parametrize("name", ["rectangle", "right triangle", "L", "butterfly"])
def test_squeeze_mirrored_or_half_turned_scene_ends_likewise(name):
    part, poses = simulator(OUTLINES[name]()), random_poses(np.random.default_rng(2), 40, 12.75)
    half_turn = np.array([0.0, 0.0, math.pi])
    final, widths, statuses = squeeze(part, poses)
    for other, scale, shift in ((mirrored(part), MIRROR, 0.0), (part, [-1, -1, 1], half_turn)):
        seen, seen_widths, seen_statuses = squeeze(other, poses * scale + shift)
        assert statuses == seen_statuses
        assert np.allclose(final * scale + shift, seen, atol=1e-9)
        assert np.allclose(widths, seen_widths, atol=1e-9)


# Statuses, extremes and determinism.


@pytest.mark.parametrize("step_mm", [0.05, 0.4])
def test_squeeze_part_thinner_than_a_step_is_grasped(step_mm):
    """A part of 30 x 0.15 mm is held flat, although the fingers close by up to 0.8 mm a step."""
    part = simulator(sliver(), step_mm=step_mm)
    _, widths, statuses = squeeze(part, [[0.0, 5.0, 0.0], [2.0, -3.0, math.pi], [0.0, 0.0, 0.1]])
    assert statuses == ["grasped"] * 3
    assert np.allclose(widths, 0.15, atol=0.02)


def test_roll_out_other_workers_is_identical():
    part = simulator(l_shape())
    poses = random_poses(np.random.default_rng(5), 600, 12.75)
    parameters = part.sample(600, np.random.default_rng(6))
    alone = part.roll_out(poses, parameters)
    shared = replace(part, workers=2).roll_out(poses, parameters)
    assert [a.tobytes() for a in alone] == [b.tobytes() for b in shared]


@pytest.mark.parametrize("name", ["rectangle", "butterfly", "ellipse", "hexagon"])
def test_roll_out_scaled_scene_has_the_same_statuses(name):
    part = simulator(OUTLINES[name]())
    small = replace(
        part,
        outline=0.1 * part.outline,
        jaws=Jaws(*(0.1 * mm for mm in part.jaws[:3]), part.jaws.upper_share),
        surface=replace(part.surface, rho_mm=0.1 * part.surface.rho_mm),
        step_mm=0.1 * part.step_mm,
    )
    poses = random_poses(np.random.default_rng(3), 500, 12.0)
    parameters = part.sample(500, np.random.default_rng(4))
    large = part.roll_out(poses, parameters)
    tiny = small.roll_out(poses * [0.1, 0.1, 1.0], parameters)
    alike = np.abs(10.0 * tiny.width_mm - large.width_mm) < 0.05
    assert alike.mean() > 0.9
    assert np.mean(tiny.status[alike] == large.status[alike]) > 0.985
