"""Pushes proposed from a belief: where they begin and end, and which are chosen."""

import math

import numpy as np
import pytest
from rectangle import JOB_PATH

from planner.belief.particles import PUSHED, UNREAD, Belief, initial
from planner.belief.transition import Push
from planner.frames import to_hand
from planner.job import model as job_file
from planner.mechanics.clearance import STANDS_ON, Jaws, classify_contact
from planner.problem import Problem
from planner.search.actions import actions_of
from planner.search.pushes import FINALISTS, MOST, Pusher
from planner.search.ranking import Ranking
from planner.search.search import Search
from runtime.shell.errors import InputError

PUSHING = {"actions": {"proposals": "belief", "pushes": "belief"}}


@pytest.fixture(scope="module")
def job():
    return job_file.load(JOB_PATH, PUSHING)


@pytest.fixture(scope="module")
def problem(job):
    return Problem.of(job, 1)


@pytest.fixture(scope="module")
def pusher(problem):
    return Pusher(problem)


@pytest.fixture(scope="module")
def belief(job):
    return Belief.of(initial(job, 400, np.random.default_rng(1)))


def read(belief: Belief) -> Belief:
    """The belief as if after a squeeze: stretched along x, displaced, and with a reading."""
    poses = belief.poses * np.array([1.0, 0.2, 0.05]) + np.array([7.0, -4.0, 0.8])
    return Belief.of(poses, np.full(len(belief), 100), belief.traits)


def under(pusher: Pusher, belief: Belief, push: Push, along_mm: float, less_mm: float = 0.0) -> int:
    """Number of parts under the fingers after `along_mm` of a push; the fingers are smaller by `less_mm`."""
    ahead = np.array([math.cos(push.start[2]), math.sin(push.start[2]), 0.0])
    _, length, thickness, share = pusher.jaws
    jaws = Jaws(push.opening_mm + less_mm, length - less_mm, thickness - less_mm, share)
    hand = to_hand(belief.poses, push.start + along_mm * ahead)
    outline = pusher.model.simulator.outlines[0]
    return int((classify_contact(outline, jaws, hand) == STANDS_ON).sum())


@pytest.mark.parametrize("of", [lambda belief: belief, read], ids=["before a squeeze", "after one"])
def test_options_begin_clear_of_the_belief_and_go_through_it(pusher, belief, of):
    options = pusher.options(of(belief))
    assert options
    for push in options:
        assert under(pusher, of(belief), push, 0.0) == 0
        # Open fingers may pass beside the parts.
        assert push.opening_mm or under(pusher, of(belief), push, 3.0)
        pushed = pusher.model.push(of(belief), push, np.random.default_rng(2))
        assert under(pusher, pushed, push, push.way_mm, less_mm=0.4) == 0
        assert np.any(pushed.poses != of(belief).poses)


def test_push_keeps_readings_and_marks_the_belief_as_touched(pusher, belief):
    push = pusher.options(belief)[0]
    pushed = pusher.model.push(belief, push, np.random.default_rng(4))
    assert set(belief.reading) == {UNREAD}
    assert set(pushed.reading) == {PUSHED}
    assert pushed.touched
    assert not belief.touched
    again = pusher.model.push(read(belief), push, np.random.default_rng(4))
    assert set(again.reading) == {100}
    assert again.traits is not None


def test_best_pushes_are_few_and_begin_clear_of_the_belief(problem, pusher, belief):
    rng, ranking = np.random.default_rng(7), Ranking(problem, actions_of(problem.job))
    finalists = pusher.best(belief, None, ranking, rng)
    assert 0 < len(finalists) <= FINALISTS
    for pushes in finalists:
        assert 1 <= len(pushes) <= MOST
        lying = pusher.pushed(belief, pushes, rng)
        assert lying.touched
        assert len(lying) == 2 * len(belief)
        assert under(pusher, belief, pushes[0], 0.0) == 0


def test_job_with_pushes_none_equals_job_without_the_key(job):
    stated = job_file.load(JOB_PATH, {"actions": {"pushes": "none"}})
    assert stated.canonical() == job_file.load(JOB_PATH).canonical()
    assert Search(Problem.of(stated, 1), np.random.default_rng(0)).pusher is None
    assert job_file.from_canonical(job.canonical()) == job


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"actions": {"pushes": "sometimes"}}, "pushes"),
        ({"actions": {"pushes": "belief", "proposals": "none"}}, "follow what was pushed"),
        ({**PUSHING, "search": {"method": "paper"}}, "which the paper's methods do not know"),
    ],
)
def test_load_contradictory_pushes_raises(changes, reason):
    with pytest.raises(InputError, match=reason):
        job_file.load(JOB_PATH, changes)
