"""Placements relative to a believed pose."""

import dataclasses
from pathlib import Path

import numpy as np
import problems
import pytest

from planner.frames import to_hand
from planner.job import model as job_file
from planner.search.proposals import hands_about, placed, proposals_of, stable_angles

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"


def width(outline, angle):
    """Between long parallel jaws at a hand angle."""
    return np.ptp(outline @ np.array([-np.sin(angle), np.cos(angle)]))


@pytest.fixture(scope="module")
def job():
    job = job_file.load(RECTANGLE)
    return dataclasses.replace(job, actions=dataclasses.replace(job.actions, proposals="belief"))


@pytest.mark.parametrize("name", ["right triangle", "butterfly", "L", "ellipse", "hexagon"])
def test_the_first_stable_angle_is_the_narrowest_of_all(name):
    outline = problems.OUTLINES[name]()
    widths = [width(outline, angle) for angle in np.radians(np.arange(0.0, 180.0, 0.25))]
    assert width(outline, stable_angles(outline)[0]) <= min(widths) + 0.2


def test_proposals_turn_and_move_with_the_part(job):
    (proposals,) = proposals_of(job)
    pose = np.array([3.0, -2.0, 0.7])
    seen = [to_hand(pose, placement) for placement in placed(proposals.relative, pose)]
    expected = [to_hand(np.zeros(3), placement) for placement in proposals.relative]
    np.testing.assert_allclose(np.array(seen)[:, :2], np.array(expected)[:, :2], atol=1e-9)
    turn = np.array(seen)[:, 2] - np.array(expected)[:, 2]
    np.testing.assert_allclose(np.cos(turn), 1.0)


def test_every_proposed_finger_reaches_the_part(job):
    half, outline = 0.5 * job.gripper.finger_length_mm, job.part.outline_mm
    for x, y, angle in proposals_of(job)[0].relative:
        along = (outline - [x, y]) @ np.array([np.cos(angle), np.sin(angle)])
        assert along.min() < half
        assert along.max() > -half


@pytest.mark.parametrize("reach", [4.0, 30.0])
def test_hands_all_about_a_part_touch_it_from_every_direction_and_the_first_few_do_already(reach):
    half = 13.75
    hands = hands_about(reach, half, 512)
    np.testing.assert_array_equal(hands_about(reach, half, 64), hands[:64])
    along, across, _ = to_hand(np.zeros((1, 3)), hands.T).T
    assert np.hypot(np.maximum(np.abs(along) - half, 0.0), across).max() < reach
    for n in (64, 512):
        for values, width in ((hands[:n, 2], np.pi), (along[:n], 2.0 * (half + 0.8 * reach))):
            occupied = np.unique(np.floor(8.0 * np.mod(values / width, 1.0)), return_counts=True)[1]
            assert len(occupied) == 8
            assert occupied.min() > 0.6 * n / 8
