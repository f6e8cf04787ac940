"""The message if every first squeeze collides.

It states how much opening the jaws lack, and up to which radius of the parts' disc they open wide enough.
"""

import numpy as np
import pytest
from rectangle import JOB_PATH

from planner.diagnosis.clearance import no_first_squeeze, shortage
from planner.job import model as job_file
from planner.part.outline import reach

JOB = job_file.load(JOB_PATH)
WIDE = JOB.replaced(uncertainty={"radius_mm": 40.0})


@pytest.mark.parametrize("radius_mm", [40.0, 300.0])
def test_shortage_wide_disc_equals_the_closed_form(radius_mm):
    result = shortage(JOB.replaced(uncertainty={"radius_mm": radius_mm}))
    # Parts lie at any angle, so that the reach counts in all directions; the least clearance is 0.5 mm.
    around = reach(JOB.part.outline_mm) + 0.5
    wide_mm = 2.0 * (radius_mm + around)
    assert result.missing_mm == pytest.approx(wide_mm - JOB.gripper.opening_mm, abs=1.0)
    assert result.radius_mm == pytest.approx(0.5 * JOB.gripper.opening_mm - around, abs=0.5)


def test_shortage_radius_is_the_largest_with_a_first_squeeze():
    result = shortage(WIDE)
    assert shortage(WIDE.replaced(uncertainty={"radius_mm": result.radius_mm})) is None
    assert shortage(WIDE.replaced(uncertainty={"radius_mm": result.radius_mm + 0.5})) is not None


def test_shortage_part_that_never_fits_states_no_radius():
    long = np.array([[0.0, 0.0], [90.0, 0.0], [90.0, 20.0], [0.0, 20.0]])
    job = JOB.replaced(part={"outline_mm": long - long.mean(axis=0), "symmetry": 2})
    assert shortage(job).radius_mm is None
    assert "even for a part in the middle" in no_first_squeeze(job)


def test_shortage_collision_free_job_is_none():
    assert shortage(JOB) is None
    assert "collision" not in no_first_squeeze(JOB)


@pytest.mark.parametrize(("distance_mm", "met"), [(21.0, True), (19.0, False)])
def test_no_first_squeeze_states_whether_the_goal_is_already_met(distance_mm, met):
    disc = {"radius_mm": 20.0, "orientation_halfwidth_deg": 0.0}
    job = JOB.replaced(uncertainty=disc, goal={"distance_mm": distance_mm})
    assert ("met before any squeeze" in no_first_squeeze(job)) == met
