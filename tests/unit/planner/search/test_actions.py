"""Grasp poses at which the open hand may be placed."""

import numpy as np
import problems
import pytest

from planner.belief.metric import Metric, Mode
from planner.belief.particles import Belief
from planner.mechanics.clearance import free_placements, least_clearance
from planner.problem import Problem
from planner.search.actions import ActionSet, actions_of, middle_of
from planner.search.proposals import Proposals
from planner.search.ranking import Ranking


@pytest.fixture(scope="module")
def job(job):
    return job.replaced(actions={"proposals": "belief"})


@pytest.mark.parametrize("name", ["rectangle", "L", "butterfly"])
@pytest.mark.parametrize("least", [0.0, 0.5, 5.0])
def test_free_placements_agree_with_least_clearance(name, least):
    rng = np.random.default_rng(3)
    outline = problems.OUTLINES[name]()
    placements = problems.random_poses(rng, 60, 45.0)
    belief = problems.random_poses(rng, 5, 8.0)
    free = free_placements(outline, problems.JAWS, belief, placements, least)
    jaws = problems.JAWS
    slow = [least_clearance(outline, jaws, belief, each) >= least for each in placements]
    assert free.tolist() == slow
    assert free.any()
    assert not free.all()


def test_along_sides_places_proposals_about_modes_and_middles():
    metric = Metric(3.0, 10.0, 1)
    belief = np.repeat([[5.0, 0.0, 0.0], [-5.0, 0.0, np.pi]], [60, 40], axis=0)
    area = np.array([[-10.0, -10.0], [10.0, 10.0]])
    relative = np.array([[0.0, 0.0, 0.0], [7.0, 0.0, 0.5]])
    actions = ActionSet(np.zeros((1, 3)), (Proposals(relative, relative[:0]),), area)
    sides = actions.along_sides(belief, metric)
    np.testing.assert_allclose(sides.about_modes[:, 0], [5.0, 12.0, -5.0, -12.0], atol=1e-9)
    np.testing.assert_allclose(sides.about_middles[:, 0], [0.0, 7.0, 0.0, -7.0], atol=1e-9)
    np.testing.assert_allclose(sides.about_middles[:, 2], sides.about_modes[:, 2])
    assert len(actions.within(sides.about_modes)) == 2


def test_middle_of_mode_without_states_at_its_angle_is_its_pose():
    pose = np.array([1.0, 2.0, np.pi / 2])
    states = np.repeat([[3.0, 4.0, 0.0]], 5, axis=0)
    np.testing.assert_array_equal(middle_of(states, Mode(pose, 1.0)), pose)


def test_candidates_blocked_at_the_mode_are_placed_at_the_middle(job):
    problem = Problem.of(job, 1)
    x = np.concatenate([np.linspace(15.0, 55.0, 41), np.full(40, 55.0)])  # most lie at one end
    poses = np.column_stack([x, np.zeros((len(x), 2))])
    held = Belief.of(poses, reading=np.zeros(len(x), np.int64))
    grasps = Ranking(problem, actions_of(job)).candidates(held, held)
    across = grasps[np.abs(np.cos(grasps[:, 2])) < 1e-6]
    np.testing.assert_allclose(across[:, 0], 35.0)
    assert len(across)
    outline, jaws = problem.mixture.outlines[0], problem.mixture.jaws
    assert all(least_clearance(outline, jaws, poses, grasp) > 0.0 for grasp in across)
