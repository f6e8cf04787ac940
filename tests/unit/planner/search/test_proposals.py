"""Placements relative to a believed pose."""

import dataclasses
from pathlib import Path

import numpy as np
import problems
import pytest

from planner.frames import to_hand
from planner.job import model as job_file
from planner.search.proposals import around, proposals_of, refined, stable_angles

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"


def width(outline, angle):
    """Between long parallel jaws at a hand angle."""
    return np.ptp(outline @ np.array([-np.sin(angle), np.cos(angle)]))


@pytest.fixture(scope="module")
def job():
    job = job_file.load(RECTANGLE)
    return dataclasses.replace(job, actions=dataclasses.replace(job.actions, proposals="belief"))


def test_a_rectangle_rests_on_its_sides_the_long_ones_first():
    np.testing.assert_allclose(stable_angles(problems.rectangle()), [0.0, np.pi / 2], atol=1e-9)


@pytest.mark.parametrize("name", ["right triangle", "butterfly", "L", "ellipse", "hexagon"])
def test_the_first_stable_angle_is_the_narrowest_of_all(name):
    outline = problems.OUTLINES[name]()
    widths = [width(outline, angle) for angle in np.radians(np.arange(0.0, 180.0, 0.25))]
    assert width(outline, stable_angles(outline)[0]) <= min(widths) + 0.2


def test_a_disc_has_some_angle_and_few_of_them():
    assert 1 <= len(stable_angles(problems.disc())) <= 4


def test_proposals_turn_and_move_with_the_part(job):
    (proposals,) = proposals_of(job)
    pose = np.array([3.0, -2.0, 0.7])
    seen = [to_hand(pose, placement) for placement in proposals.about(pose)]
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
def test_hands_all_about_a_part_have_their_middle_or_one_end_over_it_in_every_direction(reach):
    half = 13.75
    hands = around(reach, half)
    along = hands[:, 0] * np.cos(hands[:, 2]) + hands[:, 1] * np.sin(hands[:, 2])
    across = hands[:, 1] * np.cos(hands[:, 2]) - hands[:, 0] * np.sin(hands[:, 2])
    np.testing.assert_allclose(across, 0.0, atol=1e-9)
    ends = np.abs(along[:, None] + [-half, 0.0, half]).min(axis=1)
    assert np.all(ends <= 0.6 * reach + 1e-9)
    turns = np.unique(np.round(np.degrees(hands[:, 2]), 6))
    np.testing.assert_allclose(turns, np.arange(0.0, 180.0, 15.0), atol=1e-6)
    for turn in turns:
        here = np.sort(along[np.isclose(np.degrees(hands[:, 2]), turn)])
        np.testing.assert_allclose(here, -here[::-1], atol=1e-9)
        assert len(np.unique(np.round(here, 6))) == 7


def test_a_job_may_want_none(job):
    actions = dataclasses.replace(job.actions, proposals="none")
    assert proposals_of(dataclasses.replace(job, actions=actions)) == ()


def test_a_refined_placement_is_turned_or_slid_along_its_fingers():
    placement = np.array([1.0, 2.0, 0.3])
    for x, y, angle in refined(placement):
        across = -np.sin(0.3) * (x - 1.0) + np.cos(0.3) * (y - 2.0)
        assert abs(across) < 1e-12
        assert (angle == 0.3) != (x == 1.0 and y == 2.0)


def test_only_a_part_whose_halves_differ_is_squeezed_beside_the_middle(job):
    half = 0.5 * job.gripper.finger_length_mm
    for order, shifts in ((1, (-half, half)), (2, ()), (3, (-half, half)), (6, ())):
        part = dataclasses.replace(job.part, symmetry=order)
        assert proposals_of(dataclasses.replace(job, part=part))[0].shifts_mm == shifts
