"""Beliefs whose particles carry their own friction."""

from pathlib import Path

import numpy as np
import problems
import pytest

from planner.belief.observation import encoder_of
from planner.belief.particles import (
    ROUGH,
    SLIPPERY,
    frictions,
    initial,
    initial_with_friction,
    replenish,
    subsample,
    without_friction,
)
from planner.belief.transition import Simulation
from planner.job import model as job_file

TREES = Path(__file__).parents[4] / "trees"
LOW, HIGH = 0.4, 0.6


@pytest.fixture(scope="module")
def job():
    return job_file.load(TREES / "rectangle" / "job.toml")


def test_a_share_of_the_particles_doubts_the_stated_friction_half_of_it_either_way(job):
    belief = initial_with_friction(job, 40_000, np.random.default_rng(1))
    carried = belief[~np.isnan(belief[:, 3]), 3]
    assert abs(len(carried) / 40_000 - job.friction.doubt) < 4.0 * np.sqrt(0.25 / 40_000)
    slippery, rough = carried[carried < LOW], carried[carried > HIGH]
    assert len(slippery) + len(rough) == len(carried)
    assert abs(len(slippery) / len(carried) - 0.5) < 4.0 * np.sqrt(0.25 / len(carried))
    assert SLIPPERY * LOW <= slippery.min() < 1.02 * SLIPPERY * LOW
    assert 0.98 * ROUGH * HIGH < rough.max() <= ROUGH * HIGH


def test_poses_are_those_of_a_belief_without_doubt(job):
    poses = initial(job, 100, np.random.default_rng(2))
    assert np.array_equal(initial_with_friction(job, 100, np.random.default_rng(2))[:, :3], poses)
    certain = job.replaced(friction={"doubt": 0})
    assert np.isnan(initial_with_friction(certain, 100, np.random.default_rng(2))[:, 3]).all()


def test_thinned_and_repeated_particles_keep_their_friction(job):
    belief = initial_with_friction(job, 300, np.random.default_rng(3))
    rows = {row.tobytes() for row in belief}
    for other in (subsample(belief, 70), replenish(belief, 500)):
        assert other.shape[1] == 4
        assert {row.tobytes() for row in other} <= rows


def test_particles_without_a_fourth_column_carry_nothing():
    poses = np.zeros((3, 3))
    carried = frictions([poses, np.full((2, 4), 0.7), without_friction(poses)])
    assert np.array_equal(carried, [*[np.nan] * 3, 0.7, 0.7, *[np.nan] * 3], equal_nan=True)


def test_a_particle_is_squeezed_with_its_friction_and_keeps_it(job):
    """Fingers almost without friction hardly ever hold a part by a diagonal; those of the job often do."""
    simulator = problems.simulator(problems.rectangle())
    model, rng = Simulation(simulator, encoder_of(job)), np.random.default_rng(4)
    poses = initial(job, 2000, rng)
    carried = np.where(np.arange(2000) % 2 == 0, 0.01, np.nan)
    belief = np.concatenate([poses, carried[:, None]], axis=1)
    (outcomes,) = model.squeeze([(belief, np.zeros(3))], rng)
    after = np.concatenate(outcomes.beliefs)
    assert np.isnan(after[:, 3]).sum() == 1000
    assert set(after[~np.isnan(after[:, 3]), 3].tolist()) == {0.01}
    width = np.repeat(encoder_of(job).width_mm(outcomes.clusters.mean), [len(b) for b in outcomes.beliefs])
    diagonal = (width > 33.0) & (width < 40.0)
    slippery = ~np.isnan(after[:, 3])
    assert np.mean(diagonal[~slippery]) > 0.02
    assert np.mean(diagonal[slippery]) < 0.2 * np.mean(diagonal[~slippery])
