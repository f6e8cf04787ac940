"""The standard set of worlds that are not as planned."""

import math

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
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.evaluate import evaluate, sweep
from planner.job.schema import MOST_FRICTION
from planner.world import ContactWorlds

NO_DOUBT = {"chance": 0, "finger_share": [0, 0], "middle_mm": [0, 0], "encoder_mm": [0, 0]}


@pytest.fixture(scope="module")
def job(job):
    """The rectangle in a cell that nobody doubts."""
    return job.replaced(doubt=NO_DOUBT, part={"tolerance_mm": 0})


def worlds(real):
    return ContactWorlds.of_job(real, 5)


@pytest.mark.parametrize("name", OUTLINES)
def test_every_part_can_be_put_into_every_world(job, name):
    outline = OUTLINES[name]().tolist()
    part = job.replaced(part={"outline_mm": outline, "symmetry": "auto"})
    for case in standard_cases(part):
        real = case.job(part)
        assert (real == part) == (not case.changes)
        same = np.array_equal(real.part.outline_mm, part.part.outline_mm)
        assert same == ("part" not in case.changes)


def test_only_the_world_differs_from_case_to_case(job, table):
    cases = [case for case in standard_cases(job) if case.name in ("as planned", "encoder +1 mm")]
    plain, moved = sweep(table, job, cases, 1000, 3, worlds=worlds)
    assert np.array_equal(plain.evaluation.initial, moved.evaluation.initial)
    assert np.array_equal(plain.evaluation.poses, evaluate(table, job, worlds(job), 1000, 3).poses)
    shift = 1.0 / job.gripper.resolution_mm
    shifts = plain.evaluation.steps[:, 0] - moved.evaluation.steps[:, 0]
    assert set(np.unique(shifts)) <= {math.floor(shift), math.ceil(shift)}


def test_a_centred_uneven_gripper_holds_the_narrowest_side_where_the_hand_is_sent(job):
    (case,) = [
        case for case in standard_cases(job) if case.name == "upper finger moves 40%, centred"
    ]
    real = case.job(job)
    world = ContactWorlds.of_job(real, 1).world(0)
    # Flush between the fingers, 21 mm across; the hand itself was displaced.
    poses, width, _, _ = world.squeeze_many(np.array([[0.0, -case.disturbance.across_mm, 0.0]]))
    assert width == pytest.approx([21.0], abs=0.1)
    assert poses[0, 1] + case.disturbance.across_mm == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize(
    "cases", [standard_cases, offset_cases, noise_cases, friction_cases, assumption_cases]
)
def test_every_list_of_worlds_fits_the_greatest_friction_that_a_job_may_state(job, cases):
    rough = job.replaced(friction={"finger_part_min": 1.4, "finger_part_max": MOST_FRICTION})
    worlds_ = cases(rough)
    assert len({case.name for case in worlds_}) == len(worlds_)
    for case in worlds_:
        case.job(rough)  # which is checked


def test_worlds_that_a_job_believes_in_are_the_ends_of_its_doubts(job):
    assert believed_cases(job.replaced(friction={"doubt": 0})) == []
    doubt = {"finger_share": [-0.1, 0.05], "middle_mm": [0, 1], "encoder_mm": [-1, 1]}
    doubt |= {"pressure": "any", "least_dof": 20}
    any_form = {"limit_surface": "any"}
    cases = believed_cases(job.replaced(doubt=doubt, pressure=any_form, part={"tolerance_mm": 0.2}))
    assert len({case.name for case in cases}) == len(cases) == 12
    assert {case.disturbance.encoder_offset_mm for case in cases} == {-1.0, 0.0, 1.0}


def test_a_constant_error_of_the_arm_is_a_change_of_frame(job, table):
    """Parts that the hand never meets lie in its frame where they lay, less the error."""
    bias = Disturbance(bias_mm=(120.0, 0.0))
    displaced = evaluate(table, job, worlds(job), 200, 3, disturbance=bias)
    assert displaced.poses == pytest.approx(displaced.initial - bias.bias)
    near = evaluate(table, job, worlds(job), 1000, 3, disturbance=Disturbance(bias_mm=(1.5, 0.0)))
    assert near.success.mean() > 0.99
