"""Pushes proposed from a belief: where they begin and end, and that a choice without them comes first."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from planner.belief.particles import PUSHED, UNREAD, Belief, initial
from planner.belief.transition import Push, costs_of
from planner.errors import ValueRangeError
from planner.frames import to_hand
from planner.job import model as job_file
from planner.lower import _push
from planner.mechanics.clearance import STANDS_ON, classify_contact
from planner.search.pushes import LEAST_SHARE, Pusher, pusher_of
from planner.search.ranking import Choice

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"
PUSHING = {"actions": {"pushes": "belief", "proposals": "belief"}}


@pytest.fixture(scope="module")
def job():
    return job_file.load(RECTANGLE, PUSHING)


@pytest.fixture(scope="module")
def pusher(job):
    return pusher_of(job, 1)


@pytest.fixture(scope="module")
def belief(job):
    return Belief.of(initial(job, 400, np.random.default_rng(1)))


def read(belief: Belief) -> Belief:
    """The same as after a squeeze, drawn out along x."""
    poses = belief.poses * np.array([1.0, 0.2, 0.05]) + np.array([7.0, -4.0, 0.8])
    return Belief.of(poses, np.full(len(belief), 100), belief.traits)


def under(pusher: Pusher, belief: Belief, push: Push, along_mm: float, less_mm: float = 0.0) -> int:
    """Parts of a belief that fingers stand on which have come so far along their way, thinner by so much."""
    ahead = np.array([math.cos(push.start[2]), math.sin(push.start[2]), 0.0])
    _, length, thickness, share = pusher.jaws
    jaws = np.array([push.opening_mm + less_mm, length - less_mm, thickness - less_mm, share])
    hand = to_hand(belief.poses, push.start + along_mm * ahead)
    return int((classify_contact(pusher.model.simulator.outlines[0], jaws, hand) == STANDS_ON).sum())


@pytest.mark.parametrize("of", [lambda belief: belief, read], ids=["before a squeeze", "after one"])
def test_pushes_begin_clear_of_a_belief_and_go_through_it(pusher, belief, of):
    options = pusher.options(of(belief))
    assert options
    for push in options:
        assert under(pusher, of(belief), push, 0.0) == 0
        assert push.opening_mm or under(pusher, of(belief), push, 3.0)  # open ones may pass beside
        pushed = pusher.model.push(of(belief), push, np.random.default_rng(2))
        assert under(pusher, pushed, push, push.way_mm, less_mm=0.4) == 0
        assert np.any(pushed.poses != of(belief).poses)


def test_closed_fingers_leave_no_part_behind_their_face(pusher, belief):
    closed = [push for push in pusher.options(belief) if push.opening_mm == 0.0]
    after = pusher.model.push(belief, closed[0], np.random.default_rng(3))
    face = closed[0].start[0] + closed[0].way_mm + 0.5 * pusher.jaws[1]
    ahead = after.poses[np.abs(after.poses[:, 1]) < 5.0]  # others may have slid off to a side
    assert len(ahead) > 20
    assert np.all(ahead[:, 0] > face)


def test_parts_anyhow_about_a_disc_are_pushed_one_way_and_others_four(job, pusher, belief):
    assert {float(push.start[2]) for push in pusher.options(belief)} == {0.0}
    known = job.replaced(uncertainty={"orientation_halfwidth_deg": 20.0})
    for own, lying in ((pusher, read(belief)), (pusher_of(known, 1), belief)):
        angles = np.array(sorted({float(push.start[2]) for push in own.options(lying)}))
        assert np.diff(angles) == pytest.approx([0.5 * np.pi] * 3)


def test_none_begins_or_ends_outside_the_work_area(job, belief):
    narrow = job.replaced(cell={"work_area_mm": [[-40, -40], [40, 40]]})
    assert pusher_of(narrow, 1).options(belief) == []


def test_a_belief_of_one_particle_is_pushed_as_any(pusher, belief):
    one = read(belief)[np.arange(1)]
    assert len(pusher.options(one)) == len(pusher.options(read(belief)))


def test_a_pushed_belief_is_touched_and_keeps_what_was_read(pusher, belief):
    push = pusher.options(belief)[0]
    pushed = pusher.model.push(belief, push, np.random.default_rng(4))
    assert set(belief.reading) == {UNREAD}
    assert set(pushed.reading) == {PUSHED}
    assert pushed.touched
    assert not belief.touched
    again = pusher.model.push(read(belief), push, np.random.default_rng(4))
    assert set(again.reading) == {100}
    assert again.traits is not None


class Squeezes:
    """A look-ahead whose choice costs as much as the belief is wide along x; few particles find none."""

    def __init__(self):
        self.ranking = SimpleNamespace(candidates=lambda *_: np.zeros((0, 3)), squeeze=lambda *_: [])

    def choose(self, belief, rng, most=1, share=1.0, vain=0):
        return [Choice(np.zeros(3), float(np.ptp(belief.poses[:, 0])), 1.0)]


def test_the_best_without_a_push_comes_first_whatever_pushes_promise(pusher, belief):
    plain = [Choice(np.zeros(3), 1e3, 1.0), Choice(np.ones(3), 2e3, 1.0)]
    found = pusher.choose(belief, plain, Squeezes(), np.random.default_rng(5), 3, 1.0)
    assert found[0] is plain[0]
    assert len(found) == 3
    assert found[1].pushes
    assert found[1].cost_to_go < found[2].cost_to_go < plain[0].cost_to_go
    width = np.ptp(belief.poses[:, 0])
    price = sum(map(pusher.costs.of_push, found[1].pushes))
    assert found[1].cost_to_go - price < width  # what it is pushed for


def test_where_nothing_can_be_squeezed_pushes_come_first_alone(pusher, belief):
    found = pusher.choose(belief, [], Squeezes(), np.random.default_rng(5), 3, 1.0)
    assert found
    assert all(choice.pushes for choice in found)


def test_pushes_are_not_tried_for_few_parts_nor_needlessly_in_hasty_trees(pusher, belief):
    plain = [Choice(np.zeros(3), 3.0, 1.0)]
    rng, state = np.random.default_rng(6), np.random.default_rng(6).bit_generator.state
    assert pusher.choose(belief, plain, Squeezes(), rng, 3, 0.5 * LEAST_SHARE) == plain
    sparing = replace(pusher, sparing=True)
    assert sparing.choose(belief, plain, Squeezes(), rng, 3, 1.0) == plain
    assert rng.bit_generator.state == state
    assert sparing.choose(belief, [], Squeezes(), rng, 3, 1.0)


def test_a_push_after_another_begins_clear_of_all_that_the_first_has_moved(pusher, belief):
    rng = np.random.default_rng(7)
    few = belief[np.arange(20)]
    pairs = [pushes for pushes in pusher._best(few, Squeezes(), rng) if len(pushes) == 2]
    assert pairs
    for pair in pairs:
        first, second = pusher._after(belief, pair, Squeezes(), rng, 1.0)[0].pushes
        lying = pusher.model.push(belief, first, np.random.default_rng(8))
        assert under(pusher, lying, second, 0.0) <= 2  # of other draws of the same push
        ends = [push.start[:2] + push.way_mm * np.array([math.cos(push.start[2]), math.sin(push.start[2])])
                for push in (pair[1], second)]  # fmt: skip
        assert ends[0] == pytest.approx(ends[1])


def test_the_price_of_a_push_is_its_time_where_seconds_cost(job):
    push = Push(np.zeros(3), 25.0, 45.0)
    free, dear = (costs_of(job.replaced(search={"second_cost": cost})) for cost in (0.0, 0.002))
    strokes, way = 2.0 * (85.0 - 25.0) / 60.0, 45.0 / 30.0
    lift = 2.0 * (job.cell.retreat_height_mm - job.cell.squeeze_height_mm) / job.cell.arm_speed_mm_s
    assert dear.of_push(push) - free.of_push(push) == pytest.approx(0.2 * (strokes + way + lift))


def test_a_table_pushes_where_the_plan_does_as_fast_as_a_finger_closes(job):
    made = _push(Push(np.array([1.2345, -2.0, 0.5]), 21.25, 40.0), job)
    assert made == (1234, -2000, 500_000, 21_250, 40_000, 30_000)


def test_a_job_that_states_that_nothing_is_pushed_is_the_job_that_does_not(job):
    stated = job_file.load(RECTANGLE, {"actions": {"pushes": "none"}})
    assert stated.canonical() == job_file.load(RECTANGLE).canonical()
    assert pusher_of(stated) is None
    assert job_file.from_canonical(job.canonical()) == job


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"actions": {"pushes": "sometimes"}}, "pushes"),
        ({"actions": {"pushes": "belief", "proposals": "none"}}, "hands must follow what was pushed"),
        ({**PUSHING, "search": {"method": "paper"}}, "which the paper's methods do not know"),
    ],
)
def test_jobs_that_cannot_push_are_refused(changes, reason):
    with pytest.raises(ValueRangeError, match=reason):
        job_file.load(RECTANGLE, changes)
