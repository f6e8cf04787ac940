"""Opening and release of a squeeze at a given grasp pose."""

import numpy as np
import pytest

from planner.belief.observation import encoder_of
from planner.belief.particles import Belief
from planner.belief.transition import Outcomes
from planner.mechanics.clearance import jaws_of, least_clearance
from planner.mechanics.traits import as_planned
from planner.search.handling import LEAST_PARTICLES, SPARE_MM, Handling


def held_at(job, centre):
    """The outcomes of a squeeze in which all parts are held at 21 mm, with their middle at `centre`."""
    counts = np.full(50, round(230 - 21.0 / encoder_of(job).mm_per_step))
    return Outcomes([Belief.of(np.tile([*centre, 0.1], (50, 1)), counts)], 21.0)


@pytest.mark.parametrize("y", [0.0, 8.0, 18.0, 28.0])
def test_opening_clearance_is_exact_and_ample_unless_fully_open(job, y):
    belief, placement = np.tile([0.0, y, 0.0], (LEAST_PARTICLES, 1)), np.zeros(3)
    opening, clearance, _ = Handling(job).opening(Belief.of(belief), placement)
    jaws = jaws_of(job.gripper)._replace(opening_mm=opening)
    assert clearance == least_clearance(job.part.outline_mm, jaws, belief, placement)
    assert clearance >= SPARE_MM or opening == job.gripper.opening_mm


def test_opening_uneven_fingers_is_full(job):
    belief = Belief.of(np.zeros((LEAST_PARTICLES, 3)))
    uneven = job.replaced(gripper={"upper_finger_share": 0.6})
    assert Handling(uneven).opening(belief, np.zeros(3))[0] == job.gripper.opening_mm


@pytest.fixture
def belief():
    """A belief of `LEAST_PARTICLES` particles, the fewest with which the jaws open only as wide as needed."""
    return Belief.of(np.tile([[0.0, 5.0, 0.0], [0.0, -8.0, 0.1]], (LEAST_PARTICLES // 2, 1)))


def test_opening_many_particles_is_first_contact_plus_spare(job, belief):
    handling, placement = Handling(job), np.zeros(3)
    opening, clearance, _ = handling.opening(belief, placement)
    assert opening == handling.contact_mm(belief, placement) + SPARE_MM
    assert SPARE_MM <= clearance < 2 * SPARE_MM


def test_opening_after_a_push_or_with_few_particles_is_full(job, belief):
    handling, placement = Handling(job), np.zeros(3)
    assert handling.opening(belief, placement, pushed=True)[0] == job.gripper.opening_mm
    assert handling.opening(belief[1:], placement)[0] == job.gripper.opening_mm


@pytest.mark.parametrize("trait", ["share", "across_mm", "encoder_mm"])
def test_contact_mm_part_with_latent_error_is_greater(job, trait):
    poses, placement, handling = np.array([[0.0, 9.0, 0.3]]), np.zeros(3), Handling(job)
    traits = as_planned(1)
    plain = handling.contact_mm(Belief.of(poses, traits=traits), placement)
    traits[trait] = {"share": 0.1, "across_mm": -1.4, "encoder_mm": 1.1}[trait]
    assert handling.contact_mm(Belief.of(poses, traits=traits), placement) > plain


def test_release_part_near_the_edge_is_moved_to_the_middle(job):
    handling, outcomes = Handling(job), held_at(job, (145.0, 0.0))
    release = handling.release(outcomes)
    np.testing.assert_allclose(release, [0.0, 0.0])
    (belief,) = handling.released(np.array([140.0, 0.0, 0.0]), release, outcomes)
    np.testing.assert_allclose(belief.poses[0], [5.0, 0.0, 0.1])
