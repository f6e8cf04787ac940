"""The standard cases: worlds that differ from the plan."""

import numpy as np
import pytest
from problems import OUTLINES

from planner.evaluation.cases import (
    assumption_cases,
    believed_cases,
    friction_cases,
    noise_cases,
    offset_cases,
    standard_cases,
)
from planner.job.schema import MOST_FRICTION
from planner.world import ContactWorlds

NO_DOUBT = {"chance": 0, "finger_share": [0, 0], "middle_mm": [0, 0], "encoder_mm": [0, 0]}


@pytest.fixture(scope="module")
def job(job):
    """The rectangle in a cell without latent parameters."""
    return job.replaced(doubt=NO_DOUBT, part={"tolerance_mm": 0})


@pytest.mark.parametrize("name", OUTLINES)
def test_standard_cases_of_any_part_change_only_what_they_state(job, name):
    outline = OUTLINES[name]().tolist()
    part = job.replaced(part={"outline_mm": outline, "symmetry": "auto"})
    for case in standard_cases(part):
        real = case.job(part)
        assert (real == part) == (not case.changes)
        same = np.array_equal(real.part.outline_mm, part.part.outline_mm)
        assert same == ("part" not in case.changes)


def test_uneven_centred_case_holds_the_part_where_the_hand_is_sent(job):
    (case,) = [
        case for case in standard_cases(job) if case.name == "upper finger moves 40%, centred"
    ]
    real = case.job(job)
    world = ContactWorlds.of_job(real, 1).world(0)
    # The part is held flush, 21 mm across, where the hand was sent; the hand itself is displaced.
    poses, width, _, _ = world.squeeze_many(np.array([[0.0, -case.disturbance.across_mm, 0.0]]))
    assert width == pytest.approx([21.0], abs=0.1)
    assert poses[0, 1] + case.disturbance.across_mm == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    "cases", [standard_cases, offset_cases, noise_cases, friction_cases, assumption_cases]
)
def test_cases_at_greatest_friction_have_valid_jobs_and_unique_names(job, cases):
    rough = job.replaced(friction={"finger_part_min": 1.4, "finger_part_max": MOST_FRICTION})
    listed = cases(rough)
    assert len({case.name for case in listed}) == len(listed)
    for case in listed:
        case.job(rough)  # raises if the changed job is not valid


def test_believed_cases_are_the_ends_of_the_latent_intervals(job):
    assert believed_cases(job.replaced(friction={"doubt": 0})) == []
    doubt = {"finger_share": [-0.1, 0.05], "middle_mm": [0, 1], "encoder_mm": [-1, 1]}
    doubt |= {"pressure": "any", "least_dof": 20}
    any_form = {"limit_surface": "any"}
    cases = believed_cases(job.replaced(doubt=doubt, pressure=any_form, part={"tolerance_mm": 0.2}))
    assert len({case.name for case in cases}) == len(cases) == 12
    assert {case.disturbance.encoder_offset_mm for case in cases} == {-1.0, 0.0, 1.0}
