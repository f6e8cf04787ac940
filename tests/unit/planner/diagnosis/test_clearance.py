"""What a job without a first squeeze is told: how much is missing, and which radius would do."""

import numpy as np
import pytest
from rectangle import JOB_PATH

from planner.diagnosis.clearance import no_first_squeeze, shortage
from planner.job import model as job_file
from planner.part.outline import reach

JOB = job_file.load(JOB_PATH)
WIDE = JOB.replaced(uncertainty={"radius_mm": 40.0})


def test_shortage_of_a_wide_disc_is_what_reach_and_radius_exceed_the_jaws_by():
    result = shortage(WIDE)
    # At any angle the farthest vertex lies in every direction, and half a millimetre stays free.
    around = reach(JOB.part.outline_mm) + 0.5
    wide_mm = 2.0 * (40.0 + around)
    assert result.missing_mm == pytest.approx(wide_mm - JOB.gripper.opening_mm, abs=1.0)
    assert result.radius_mm == pytest.approx(0.5 * JOB.gripper.opening_mm - around, abs=0.5)


def test_radius_of_the_message_has_a_first_squeeze_and_the_stated_one_has_none():
    result = shortage(WIDE)
    assert shortage(WIDE.replaced(uncertainty={"radius_mm": result.radius_mm})) is None
    assert shortage(WIDE.replaced(uncertainty={"radius_mm": result.radius_mm + 0.5})) is not None


def test_part_that_never_passes_at_its_angles_is_refused_since_no_radius_will_do():
    long = np.array([[0.0, 0.0], [90.0, 0.0], [90.0, 20.0], [0.0, 20.0]])
    job = JOB.replaced(part={"outline_mm": long - long.mean(axis=0), "symmetry": 2})
    assert shortage(job).radius_mm is None
    assert "even for a part in the middle" in no_first_squeeze(job)


def test_job_that_is_free_of_collision_is_not_warned_of_a_collision():
    assert shortage(JOB) is None
    assert "collision" not in no_first_squeeze(JOB)


@pytest.mark.parametrize(("distance_mm", "met"), [(21.0, True), (19.0, False)])
def test_goal_beyond_the_uncertainty_is_met_before_any_squeeze(distance_mm, met):
    disc = {"radius_mm": 20.0, "orientation_halfwidth_deg": 0.0}
    job = JOB.replaced(uncertainty=disc, goal={"distance_mm": distance_mm})
    assert ("met before any squeeze" in no_first_squeeze(job)) == met
