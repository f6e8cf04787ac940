"""The objects of a planning problem, and how they fit together."""

from dataclasses import replace

import numpy as np
import pytest

from planner.belief.particles import evenly
from planner.frames import wrap
from planner.mechanics.mixture import Mixture
from planner.mechanics.traits import as_planned
from planner.problem import AHEAD_STEP_MM, STEP_MM, Problem

FINE_MM = 0.05


@pytest.fixture(scope="module")
def problem(job):
    return Problem.of(job, 1)


def test_problem_models_differ_in_the_closing_step_alone(problem):
    assert problem.model.encoder == problem.ahead.encoder == problem.encoder
    (fine,), (coarse,) = problem.mixture.simulators, problem.ahead.simulator.simulators
    assert (fine.step_mm, coarse.step_mm) == (STEP_MM, AHEAD_STEP_MM)
    for name in set(fine.__slots__) - {"step_mm"}:
        np.testing.assert_equal(getattr(coarse, name), getattr(fine, name))


@pytest.mark.parametrize("which", ["model", "ahead"])
def test_problem_closing_steps_end_where_much_smaller_ones_do(problem, job, which):
    poses, traits = evenly(job, 400, np.random.default_rng(1)), as_planned(400)
    models = [getattr(problem, which).simulator, Mixture.of_job(job, 1, FINE_MM)]
    coarse, fine = (each.squeeze(poses, np.random.default_rng(7), traits) for each in models)
    off = coarse.poses - fine.poses
    same = (np.hypot(*off[:, :2].T) < 0.3) & (np.abs(wrap(off[:, 2])) < np.radians(1.0))
    assert same.sum() >= 398
    assert np.abs(coarse.poses - poses).max() > 5.0


def test_problem_belief_is_drawn_evenly_and_located_once_narrow(problem, job):
    belief = problem.belief(500, np.random.default_rng(2))
    np.testing.assert_array_equal(belief.poses, evenly(job, 500, np.random.default_rng(2)))
    assert not problem.stopping.reached(problem.metric.mode(belief.states).ratio)
    near = replace(belief, poses=belief.poses * 0.05)
    assert problem.stopping.reached(problem.metric.mode(near.states).ratio)
