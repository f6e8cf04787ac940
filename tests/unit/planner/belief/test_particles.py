"""Beliefs whose particles carry their own friction."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import problems
import pytest

from planner.belief.metric import Metric
from planner.belief.observation import Encoder, encoder_of, resolution_of
from planner.belief.particles import (
    ROUGH,
    SLIPPERY,
    Belief,
    initial,
    initial_with_friction,
    replenish,
    subsample,
)
from planner.belief.partition import Estimate
from planner.belief.transition import Outcomes, Simulation, squeezed_by
from planner.job import model as job_file
from planner.mechanics.simulator import RollOut
from planner.search.params import SearchParams

TREES = Path(__file__).parents[4] / "trees"
LOW, HIGH = 0.4, 0.6


@pytest.fixture(scope="module")
def job():
    return job_file.load(TREES / "rectangle" / "job.toml")


def test_a_share_of_the_particles_doubts_the_stated_friction_half_of_it_either_way(job):
    belief = initial_with_friction(job, 40_000, np.random.default_rng(1))
    carried = belief.friction[~np.isnan(belief.friction)]
    assert abs(len(carried) / 40_000 - job.friction.doubt) < 4.0 * np.sqrt(0.25 / 40_000)
    slippery, rough = carried[carried < LOW], carried[carried > HIGH]
    assert len(slippery) + len(rough) == len(carried)
    assert abs(len(slippery) / len(carried) - 0.5) < 4.0 * np.sqrt(0.25 / len(carried))
    assert SLIPPERY * LOW <= slippery.min() < 1.02 * SLIPPERY * LOW
    assert 0.98 * ROUGH * HIGH < rough.max() <= ROUGH * HIGH


def test_poses_are_those_of_a_belief_without_doubt(job):
    poses = initial(job, 100, np.random.default_rng(2))
    assert np.array_equal(initial_with_friction(job, 100, np.random.default_rng(2)).poses, poses)
    certain = job.replaced(friction={"doubt": 0})
    assert np.isnan(initial_with_friction(certain, 100, np.random.default_rng(2)).friction).all()


def test_thinned_and_repeated_particles_keep_their_friction(job):
    belief = initial_with_friction(job, 300, np.random.default_rng(3))
    carried = {pose.tobytes(): mu for pose, mu in zip(belief.poses, belief.friction, strict=True)}
    for other, n in ((subsample(belief, 70), 70), (replenish(belief, 500), 500)):
        assert len(other) == len(other.friction) == n
        for pose, mu in zip(other.poses, other.friction, strict=True):
            assert np.array_equal(carried[pose.tobytes()], mu, equal_nan=True)


def test_a_particle_is_squeezed_with_its_friction_and_keeps_it(job):
    """Fingers almost without friction hardly ever hold a part by a diagonal; those of the job often do."""
    simulator = problems.simulator(problems.rectangle())
    model, rng = Simulation(simulator, encoder_of(job)), np.random.default_rng(4)
    poses = initial(job, 2000, rng)
    carried = np.where(np.arange(2000) % 2 == 0, 0.01, np.nan)
    belief = replace(Belief.of(poses), friction=carried)
    (squeezed,) = model.squeeze([(belief, np.zeros(3))], rng)
    after = squeezed.belief.friction
    assert np.isnan(after).sum() == 1000
    assert set(after[~np.isnan(after)].tolist()) == {0.01}
    width = encoder_of(job).width_mm(squeezed.belief.reading)
    diagonal = (width > 33.0) & (width < 40.0)
    slippery = ~np.isnan(after)
    assert np.mean(diagonal[~slippery]) > 0.02
    assert np.mean(diagonal[slippery]) < 0.2 * np.mean(diagonal[~slippery])


def test_an_empty_hand_is_an_outcome_of_its_own_whatever_it_reads():
    """Here 120 counts; a part of 2 mm reads 117, near enough to share a cluster if both were held."""
    encoder = Encoder(85.0, 3, 120, 0.01)
    width = np.repeat([0.0, 2.0], 50)

    def roll_out(poses, case, friction):
        return RollOut(poses, width, np.zeros(100, np.int64), np.zeros(100, np.int64))

    case = (Belief.of(np.zeros((100, 3))), np.zeros(3))
    (squeezed,) = squeezed_by([case], roll_out, encoder, np.random.default_rng(0))
    rule = SearchParams().rule(Metric(1.0, 5.0, 1), Estimate(0.99), resolution_of(encoder))
    outcomes = Outcomes.of(squeezed, rule)
    assert outcomes.clusters.size.tolist() == [50, 50]
