"""The ranking of grasp poses: the kernel's costs equal those that follow from the branches of each belief."""

import numpy as np
import pytest
from programs import TREES

from planner.belief.particles import Belief, initial
from planner.belief.transition import Outcomes
from planner.frames import wrap
from planner.job import model as job_file
from planner.mechanics.traits import as_planned
from planner.problem import Problem
from planner.search.actions import actions_of
from planner.search.ranking import ALIKE, ALIKE_MM, Ranking, judged, unlike

GUSSET = TREES / "gusset" / "job.toml"
FACES = {"part": {"faces": "either"}}
SORTED = {"goal": {"identify": False}}


@pytest.mark.parametrize("changes", [{}, FACES, FACES | SORTED], ids=str)
def test_judged_options_equal_the_heuristic_of_their_branches(changes):
    problem = Problem.of(job_file.load(GUSSET, changes), 1)
    rng, rule = np.random.default_rng(5), problem.rule
    traits = as_planned(120)
    traits["hypothesis"] = np.arange(120) % len(problem.mixture.simulators)
    belief = Belief.of(initial(problem.job, 120, rng), traits=traits)
    grasps = Ranking(problem, actions_of(problem.job)).candidates(belief, belief)[:6]
    squeezed = problem.ahead.squeeze([(belief, grasp) for grasp in grasps], rng)
    states = np.stack([each.belief.states for each in squeezed])
    reading = np.stack([each.belief.reading for each in squeezed])
    left = judged(states, reading, rule.compiled())
    for k, each in enumerate(squeezed):
        outcomes = Outcomes.of(each, rule)
        size = outcomes.clusters.size
        shares = rule.metric.shares(
            [child.states for child in outcomes.beliefs], rule.metric.modes
        ).sum(axis=1)
        ahead = list(map(rule.stopping.cost_to_go, shares * size, size))
        assert left[k] == pytest.approx(outcomes.probability @ ahead)


def test_unlike_first_squeezes_closer_than_variants_keeps_them_all():
    job = job_file.load(TREES / "rectangle-25" / "job.toml")
    problem = Problem.of(job, 1)
    ranking, lying = Ranking(problem, actions_of(job)), problem.belief(50, np.random.default_rng(2))
    first = ranking.actions.first
    squeezed = Belief(lying.poses, lying.traits, np.zeros(50, np.int64))
    assert len(ranking.unlike(squeezed, first, 16)) < len(first) == 9
    np.testing.assert_array_equal(ranking.unlike(lying, np.repeat(first, 2, axis=0), 16), first)


def test_unlike_random_grasp_poses_leaves_no_variants_and_drops_nothing_else():
    rng = np.random.default_rng(9)
    grasps = rng.uniform([-15.0, -15.0, 0.0], [15.0, 15.0, np.pi], (60, 3))

    def alike(one, other):
        shift = np.hypot(*(one - other)[:2])
        turn = abs(float(wrap(np.asarray(one[2] - other[2]), 2)))
        return shift < ALIKE_MM and turn < ALIKE

    chosen = unlike(grasps, 60)
    for k, grasp in enumerate(grasps):
        before = [grasps[j] for j in chosen if j < k]
        assert (k in chosen) == (not any(alike(grasp, other) for other in before))
