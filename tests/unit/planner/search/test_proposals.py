"""Proposals: hand placements relative to the part."""

import numpy as np
import problems
import pytest

from planner.frames import to_hand, wrap
from planner.search.proposals import (
    ALONG,
    APART_DEG,
    COVERED,
    MOST_ANGLES,
    along,
    hands_about,
    placed,
    proposals_of,
    stable_angles,
    varied,
)


@pytest.fixture(scope="module")
def job(job):
    return job.replaced(actions={"proposals": "belief"})


def width(outline, angle):
    """The width of an outline between long parallel jaws at a hand angle."""
    return np.ptp(outline @ np.array([-np.sin(angle), np.cos(angle)]))


@pytest.mark.parametrize("name", ["right triangle", "butterfly", "L", "ellipse", "hexagon"])
def test_stable_angles_first_one_is_the_narrowest(name):
    outline = problems.OUTLINES[name]()
    widths = [width(outline, angle) for angle in np.radians(np.arange(0.0, 180.0, 0.25))]
    assert width(outline, stable_angles(outline)[0]) <= min(widths) + 0.2


def test_placed_proposals_turn_and_move_with_the_part(job):
    (proposals,) = proposals_of(job)
    pose = np.array([3.0, -2.0, 0.7])
    seen = [to_hand(pose, placement) for placement in placed(proposals.relative, pose)]
    expected = [to_hand(np.zeros(3), placement) for placement in proposals.relative]
    np.testing.assert_allclose(np.array(seen)[:, :2], np.array(expected)[:, :2], atol=1e-9)
    turn = np.array(seen)[:, 2] - np.array(expected)[:, 2]
    np.testing.assert_allclose(np.cos(turn), 1.0)


def test_proposals_of_job_place_both_fingers_within_reach(job):
    half, outline = 0.5 * job.gripper.finger_length_mm, job.part.outline_mm
    for x, y, angle in proposals_of(job)[0].relative:
        along = (outline - [x, y]) @ np.array([np.cos(angle), np.sin(angle)])
        assert along.min() < half
        assert along.max() > -half


@pytest.mark.parametrize("name", problems.OUTLINES)
def test_stable_angles_are_few_and_apart_under_half_a_turn(name):
    angles = stable_angles(problems.OUTLINES[name]())
    assert 0 < len(angles) <= MOST_ANGLES
    assert np.all((angles >= 0.0) & (angles < np.pi))
    apart = np.abs(wrap(angles[:, None] - angles, 2)) + np.pi * np.eye(len(angles))
    assert apart.min() > np.radians(APART_DEG)


@pytest.mark.parametrize("turn_deg", [10, 45, 170])
def test_stable_angles_of_a_turned_part_begin_with_the_first_one_turned(turn_deg):
    outline, turn = problems.l_shape(), np.radians(turn_deg)
    first, there = stable_angles(outline)[0], stable_angles(problems.turned(outline, turn))[0]
    assert wrap(there - first - turn, 2) == pytest.approx(0.0, abs=1e-6)


def test_proposals_of_l_shape_off_centre_cover_given_shares(job):
    outline, half = problems.l_shape(), 0.5 * job.gripper.finger_length_mm
    skew = job.replaced(part={"outline_mm": outline.tolist(), "symmetry": "auto"})
    (proposals,) = proposals_of(skew)
    relative = proposals.relative.reshape(-1, 1 + 2 * len(COVERED), 3)
    for hands, angle in zip(relative, stable_angles(outline), strict=True):
        np.testing.assert_allclose(hands[:, 2], angle)
        fingers = np.array([np.cos(angle), np.sin(angle)])
        place, shift = outline @ fingers, hands[:, :2] @ fingers
        ends = [(middle - half, middle + half) for middle in shift]
        low, high = place.min(), place.max()
        shares = [(min(b, high) - max(a, low)) / (high - low) for a, b in ends]
        np.testing.assert_allclose(sorted(shares[1:]), np.repeat(COVERED, 2))
        assert sum(a > low for a, _ in ends[1:]) == len(COVERED)
    assert proposals_of(skew.replaced(actions={"proposals": "none"})) == ()


def test_hands_about_a_part_are_even_in_every_prefix_and_touch_it():
    half, radius = 13.75, 18.0
    hands = hands_about(radius, half, 1024)
    np.testing.assert_array_equal(hands_about(radius, half, 100), hands[:100])
    part = to_hand(np.zeros((1, 3)), hands.T)  # the part's middle, as each hand has it
    assert np.abs(part[:, 0]).max() < half + ALONG * radius
    assert np.abs(part[:, 1]).max() < radius
    for n in (64, 256, 1024):
        assert np.abs(part[:n, :2].mean(axis=0)).max() < 4.0 * (half + ALONG * radius) / n
        quarters = np.histogram(hands[:n, 2], 4, (0.0, np.pi))[0]
        np.testing.assert_allclose(quarters, 0.25 * n, atol=2.0)


def test_along_shifts_each_hand_in_the_direction_of_its_fingers_and_back():
    hands = problems.random_poses(np.random.default_rng(1), 20, 30.0)
    shifted = along(hands, 4.0)
    seen = np.array([to_hand(a, b) for a, b in zip(shifted, hands, strict=True)])
    np.testing.assert_allclose(seen, np.tile([4.0, 0.0, 0.0], (20, 1)), atol=1e-12)
    np.testing.assert_allclose(along(shifted, -4.0), hands, atol=1e-12)


def test_varied_hands_scatter_about_each_placement_as_stated():
    hands, n = np.array([[3.0, -2.0, 0.5], [40.0, 10.0, 2.0]]), 20_000
    variants = varied(hands, n, (2.0, 0.1), np.random.default_rng(2)).reshape(2, n, 3)
    spread = np.array([2.0, 2.0, 0.1])
    assert np.all(np.abs(variants.mean(axis=1) - hands) < 4.0 * spread / np.sqrt(n))
    np.testing.assert_allclose(variants.std(axis=1), np.tile(spread, (2, 1)), rtol=0.03)
