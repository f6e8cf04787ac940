"""Other squeezes for a node: the cheaper plan stays."""

import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle import BELIEF, RISKY, SILENT, TELLING, Oracle, look_ahead

from planner.belief.observation import Partition
from planner.belief.particles import Belief
from planner.belief.transition import Squeezed
from planner.job import model as job_file
from planner.search.actions import Action
from planner.search.expand import (
    Found,
    Growth,
    PlannedSqueeze,
    TreeNode,
    breadth_first,
    grow,
    learn,
    squeeze_at,
)
from planner.search.handling import handling_of
from planner.search.hasty import price
from planner.search.improve import _starts, improve, mend
from planner.search.params import SearchParams

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"
PATIENT = 4
MOST_WITHOUT_GAIN = SearchParams().most_without_gain
EVERY = np.ones(len(BELIEF), np.bool_)
DEAR = SearchParams(branch=20.0)
"""Branches that are dear: no cut for a few parts."""


@pytest.fixture(scope="module")
def growth():
    handling = handling_of(job_file.load(RECTANGLE))
    return Growth(look_ahead([SILENT, TELLING]), Oracle(), handling, PATIENT)


def placed(angle):
    return np.array([0.0, 0.0, angle])


def tree(growth, first, other):
    """A root, squeezed once without result, and a node that squeezes at an angle, with an alternative."""
    root = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    squeeze_at(root, None, Action(placed(SILENT)), growth, np.random.default_rng(0))
    (node,) = root.children
    node.squeezes_without_gain = 0  # else one more squeeze that tells nothing would be the last
    squeeze_at(node, root, Action(placed(first)), growth, np.random.default_rng(1))
    node.alternatives = [Action(placed(other))]
    grow(node, growth, [1])
    return root, node


def test_a_squeeze_that_tells_at_once_takes_the_place_of_one_that_does_not(growth):
    root, node = tree(growth, SILENT, TELLING)
    before = price(root, growth)
    improve(root, growth, [1])
    (node,) = root.children
    assert node.squeeze.placement[2] == TELLING
    assert price(root, growth) == pytest.approx(before - growth.objective.costs.least)
    assert all(leaf.mode.ratio == 1.0 for leaf in node.children)


class Halves(Oracle):
    """TELLING tells the side of the parts above the middle alone, RISKY that of those below."""

    def squeeze(self, cases, rng):
        squeezed = []
        for belief, placement in cases:
            above = belief.poses[:, 1] > 0.0
            telling = above if placement[2] == TELLING else ~above & (placement[2] == RISKY)
            counts = np.where(telling, np.where(belief.poses[:, 0] > 0, 200, 100), 50)
            squeezed.append(Squeezed(replace(belief, reading=counts), 0.0, 20.0))
        return squeezed


@pytest.mark.parametrize("apart", [True, False])
def test_readings_that_need_different_squeezes_are_told_apart_where_parts_are_many(growth, apart):
    """Of each reading one squeeze tells the side; of all together it takes two for some of the parts."""
    many = SearchParams().piece_particles if apart else SearchParams().piece_particles // 2
    corners = [[6.0, 6.0, 0.0], [6.0, -6.0, 0.0], [-6.0, 6.0, 0.0], [-6.0, -6.0, 0.0]]
    poses = np.tile(corners, (many, 1))
    belief = Belief.of(poses, np.where(poses[:, 1] > 0.0, 150, 151 + np.arange(len(poses)) // 4 % 2))
    model = Halves()
    halves = replace(growth, look_ahead=look_ahead([TELLING, RISKY], model=model), reference=model)
    mode = growth.objective.metric.mode(poses)
    first = PlannedSqueeze(placed(SILENT), 85.0, 0.0, Partition.of([belief.reading]), cost=1.0)
    root, node = TreeNode(belief, 1.0, mode, squeeze=first), TreeNode(belief, 1.0, mode, (0,))
    root.children, root.named = [node], 1
    squeeze_at(node, None, Action(placed(TELLING)), halves, np.random.default_rng(1))
    grow(node, halves, [1])
    before = price(root, halves)
    improve(root, halves, [1])
    saved = (before - price(root, halves)) / halves.objective.costs.least
    assert saved == pytest.approx(0.5 if apart else 0.0)
    assert len(root.children) == (3 if apart else 1)
    if apart:
        assert [child.squeeze.placement[2] for child in root.children] == [RISKY, RISKY, TELLING]
        assert [sorted(set(child.belief.reading)) for child in root.children] == [[152], [151], [150]]
    paths = [node.path for node in breadth_first(root)]
    assert len(set(paths)) == len(paths)


@given(st.lists(st.integers(0, 40), min_size=1, max_size=200), st.integers(1, 60))
def test_pieces_hold_the_readings_asked_for_and_keep_counts_whole(reading, least):
    reading = np.array(reading)
    starts = _starts(reading, least)
    size = np.bincount(np.searchsorted(starts, reading, side="right"), minlength=len(starts) + 1)
    assert size.sum() == len(reading)
    assert np.all(np.diff(starts) > 0)
    assert size.min() >= least or len(starts) == 0


def test_parts_under_a_finger_count_and_are_failures(growth):
    """One part in twenty lies where the open finger comes down: its share is nobody's, and is paid for."""
    under = np.tile([0.0, 47.0, 0.0], (len(BELIEF) // 19, 1))
    belief = Belief.joined([BELIEF, Belief.of(under)])
    root = TreeNode(belief, 0.8, growth.objective.metric.mode(belief.poses))
    squeeze_at(root, None, Action(placed(TELLING)), growth, np.random.default_rng(0))
    crashes = len(under) / len(belief)
    assert root.squeeze.crashes == pytest.approx(crashes)
    assert crashes > 0.04
    assert sum(child.share for child in root.children) == pytest.approx(0.8 * (1.0 - crashes))
    paid = price(root, growth)
    root.squeeze = root.squeeze._replace(crashes=0.0)
    assert paid - price(root, growth) == pytest.approx(0.8 * crashes)


def test_an_alternative_of_the_first_squeeze_takes_its_place_where_it_costs_less(growth):
    root = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    squeeze_at(root, None, Action(placed(SILENT)), growth, np.random.default_rng(0))
    root.alternatives = [Action(placed(TELLING))]
    grow(root, growth, [1])
    improve(root, growth, [1])
    assert root.squeeze.placement[2] == TELLING
    assert price(root, growth) == pytest.approx(growth.objective.costs.least)


def test_a_worse_one_does_not(growth):
    root, node = tree(growth, TELLING, SILENT)
    children = node.children
    improve(root, growth, [1])
    assert node.children is children
    assert node.squeeze.placement[2] == TELLING


def test_nothing_changes_once_time_is_out(growth):
    root, node = tree(growth, SILENT, TELLING)
    improve(root, growth, [1], out_of_time=lambda: True)
    assert node.squeeze.placement[2] == SILENT


def test_a_node_that_is_done_after_one_squeeze_is_left_alone(growth):
    class Forbidden:
        def squeeze(self, cases, rng):
            raise AssertionError("there is nothing to save")

    root, _ = tree(growth, TELLING, SILENT)
    improve(root, replace(growth, reference=Forbidden()), [1])


def test_an_unresolved_leaf_counts_as_a_failure_of_all_its_parts(growth):
    metric = growth.objective.metric
    nearly = BELIEF[np.repeat([0, -1], [95, 5])]
    short = TreeNode(nearly, 0.5, metric.mode(nearly.poses), squeezes_without_gain=MOST_WITHOUT_GAIN)
    assert short.mode.ratio == pytest.approx(0.95)
    assert price(short, growth) == pytest.approx(0.5 + 0.5 * 0.05)
    met = TreeNode(BELIEF[:1], 0.5, metric.mode(BELIEF[:1].poses))
    assert price(met, growth) == 0.0


def test_nodes_that_few_parts_come_to_are_left_alone(growth):
    root, node = tree(growth, SILENT, TELLING)
    node.share = 0.01
    improve(root, growth, [1])
    assert node.squeeze.placement[2] == SILENT


def test_a_leaf_that_may_be_grown_costs_what_it_is_expected_to_take(growth):
    root = TreeNode(BELIEF, 0.5, growth.objective.metric.mode(BELIEF.poses))
    squeeze, size = growth.objective.costs.least, np.array([len(BELIEF)])
    (left,) = growth.objective.rule.estimate.squeezes(root.mode.ratio * size, size)
    assert 1.0 < left < 2.0  # one squeeze more, and perhaps a second
    assert price(root, growth) == pytest.approx(0.5 * left * squeeze)
    squeeze_at(root, None, Action(placed(TELLING)), growth, np.random.default_rng(0))
    assert price(root, growth) == pytest.approx(0.5 * squeeze)


def test_subtrees_are_compared_before_their_small_leaves_are_grown(growth):
    """A share of one leaves all but the squeeze itself for later: J of its outcomes tells which is better."""
    root, node = tree(growth, SILENT, TELLING)
    squeezed = []

    class Counting(Oracle):
        def squeeze(self, cases, rng):
            squeezed.extend(cases)
            return super().squeeze(cases, rng)

    improve(root, replace(growth, reference=Counting()), [1], rough=1.0)
    (node,) = root.children
    assert node.squeeze.placement[2] == TELLING
    assert len(squeezed) == 1


def test_leaves_of_less_than_a_share_are_left_for_later(growth):
    root = TreeNode(BELIEF, 0.5, growth.objective.metric.mode(BELIEF.poses))
    grow(root, growth, [1], least=0.3)  # half of it is not located
    assert not root.children
    grow(root, growth, [1], least=0.2)
    assert root.children


def test_a_leaf_that_fails_for_good_is_mended_by_another_squeeze_above_it(growth):
    root, node = tree(growth, SILENT, TELLING)
    node.children[0].squeezes_without_gain = MOST_WITHOUT_GAIN
    node.children[0].children = []

    def fails(leaf):
        return leaf.mode.ratio < growth.objective.confidence

    assert mend(root, growth, [1], fails)
    (node,) = root.children
    assert node.squeeze.placement[2] == TELLING
    assert not mend(root, growth, [1], fails)


def test_what_no_other_squeeze_mends_is_tried_once(growth):
    root, node = tree(growth, SILENT, SILENT)
    node.children[0].squeezes_without_gain = MOST_WITHOUT_GAIN
    node.children[0].children = []
    assert not mend(root, replace(growth, max_depth=2), [1], lambda leaf: leaf.mode.ratio < 1.0)
    assert node.alternatives == []
    assert root.children == [node]


def test_a_belief_that_squeezes_tell_nothing_about_is_left_after_some(growth):
    silent = Growth(look_ahead([TELLING]), Oracle(), growth.handling, 9)
    root = leaf = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    above = None
    for squeezes_without_gain in range(1, MOST_WITHOUT_GAIN + 1):
        squeeze_at(leaf, above, Action(placed(SILENT)), silent, np.random.default_rng(0))
        above, (leaf,) = leaf, leaf.children
        assert leaf.squeezes_without_gain == squeezes_without_gain
    grow(root, silent, [1])
    assert leaf.children == []


def test_one_worker_grows_a_tree_in_the_thread_of_its_caller_whose_time_may_be_limited(growth):
    threads = set()

    class Located(Oracle):
        def squeeze(self, cases, rng):
            threads.add(threading.get_ident())
            return super().squeeze(cases, rng)

    alone = Growth(look_ahead([SILENT, TELLING], model=Located()), Located(), growth.handling, PATIENT)
    assert alone.look_ahead.ranking.mixture.workers == 1
    root = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    grow(root, alone, [1])
    assert root.children
    assert threads == {threading.get_ident()}


def test_a_leaf_that_nearly_holds_is_left_unless_trials_speak_against_it(growth):
    def leaf():
        node = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
        assert node.mode.ratio == 0.5
        return node

    left, reopened, refuted = leaf(), leaf(), leaf()
    grow(left, growth, [1], reopen=0.5)
    assert left.children == []
    grow(reopened, growth, [1], reopen=0.6)
    assert len(reopened.children) == 2
    assert learn(refuted, {0: Found(BELIEF, EVERY)}, growth, 0.4, refutes=np.any) == 1.0
    grow(refuted, growth, [1], reopen=0.4)
    assert len(refuted.children) == 2


def test_a_refuted_leaf_that_no_squeeze_improves_is_searched_again_once_its_belief_has_grown(growth):
    silent = replace(growth, look_ahead=look_ahead([SILENT]))
    leaf = TreeNode(BELIEF, 0.3, growth.objective.metric.mode(BELIEF.poses))
    assert learn(leaf, {0: Found(BELIEF, EVERY)}, silent, 0.4, refutes=np.any) == 0.3
    grow(leaf, silent, [1], reopen=0.4)
    assert leaf.children == []
    assert learn(leaf, {0: Found(BELIEF, ~EVERY)}, silent, 0.4, refutes=np.any) == 0.0
    assert learn(leaf, {0: Found(BELIEF, EVERY)}, silent, 0.4, refutes=np.any) == 0.3


def test_parts_that_a_leaf_knows_judge_it_and_are_not_learned_twice(growth):
    leaf = TreeNode(BELIEF, 0.3, growth.objective.metric.mode(BELIEF.poses))
    assert learn(leaf, {0: Found(BELIEF, ~EVERY)}, growth, 0.4, refutes=np.any) == 0.3
    assert leaf.belief is BELIEF


def test_a_refuted_leaf_grows_whatever_its_belief_says_but_not_beyond_what_is_allowed(growth):
    metric = growth.objective.metric
    belief = Belief.of(np.concatenate([BELIEF.poses[:100], BELIEF.poses[:99], BELIEF.poses[-1:]]))
    held, last, vain = (TreeNode(belief, 1.0, metric.mode(belief.states), refuted=True) for _ in range(3))
    assert held.mode.ratio >= growth.objective.confidence
    last.path, vain.squeezes_without_gain = (0,) * PATIENT, MOST_WITHOUT_GAIN
    for leaf in (held, last, vain):
        grow(leaf, growth, [1])
    assert len(held.children) == 2
    assert last.children == vain.children == []


def test_nodes_that_two_squeezes_lead_to_are_improved_too(growth):
    root, node = tree(growth, SILENT, SILENT)
    (later,) = node.children
    later.children = []
    squeeze_at(later, node, Action(placed(SILENT)), growth, np.random.default_rng(2))
    node.alternatives, later.alternatives = [], [Action(placed(TELLING))]
    improve(root, growth, [1])
    (later,) = node.children
    assert later.squeeze.placement[2] == TELLING
    assert all(leaf.mode.ratio == 1.0 for leaf in later.children)


class Late:
    """At first three counts: of one the pose is known, the others differ by nothing but how they read.

    A squeeze at TELLING brings the many poses of these to two, one for each reading, and reads the same.
    """

    def squeeze(self, cases, rng):
        squeezed = []
        for belief, placement in cases:
            poses, counts = belief.poses.copy(), np.full(len(belief), 120)
            if placement[2] == TELLING:
                poses[:, 0] = 0.0
            elif placement[2] == SILENT:
                counts = np.where(poses[:, 1] > 20.0, 40, np.where(poses[:, 1] > 0.0, 100, 110))
            squeezed.append(Squeezed(replace(belief, poses=poses, reading=counts), 0.0, 20.0))
        return squeezed


def late_tree(growth):
    """A root whose squeeze has two branches: a leaf, and a node that a squeeze at RISKY told nothing."""
    spread = np.array([[x, y, 0.0] for x in np.linspace(-300.0, 300.0, 150) for y in (-8.0, 8.0)])
    belief = Belief.of(np.concatenate([np.tile([0.0, 22.0, 0.0], (300, 1)), spread]))
    late = replace(growth, look_ahead=look_ahead([TELLING], params=DEAR), reference=Late())
    root = TreeNode(belief, 1.0, late.objective.metric.mode(belief.poses))
    squeeze_at(root, None, Action(placed(SILENT)), late, np.random.default_rng(0))
    assert len(root.children) == 2
    node = root.children[0]
    squeeze_at(node, root, Action(placed(RISKY)), late, np.random.default_rng(1))
    assert len(root.children) == 2
    node.squeezes_without_gain = 0
    return late, root, node


def test_readings_that_a_later_squeeze_shows_to_differ_become_branches(growth):
    late, root, node = late_tree(growth)
    node.children = []
    others = squeeze_at(node, root, Action(placed(TELLING)), late, np.random.default_rng(2))
    assert len(root.children) == 3
    assert len(root.squeeze.clusters.mean) == 3
    arrived = 1.0 - root.squeeze.crashes
    assert sum(child.share for child in root.children) == pytest.approx(arrived)
    low, high = root.squeeze.clusters.low, root.squeeze.clusters.high
    assert np.all(low[:-1] > high[1:]) or np.all(high[:-1] < low[1:])
    assert [leaf.mode.ratio for leaf, above in others if above is node] == [1.0]
    assert sum(above is root for _, above in others) == 1


def test_particles_from_elsewhere_are_no_share_of_the_branches_that_a_node_becomes(growth):
    late, root, node = late_tree(growth)
    node.children = []
    shares = [child.share for child in root.children]
    told = node.belief.poses[:, 1] > 0.0
    node.belief = Belief.joined([node.belief, node.belief[np.flatnonzero(told).repeat(2)]])
    node.doubted = 2 * int(told.sum())
    squeeze_at(node, root, Action(placed(TELLING)), late, np.random.default_rng(2))
    pieces = [child for child in root.children if child.share < shares[1]]
    assert len(root.children) == 3
    assert sum(child.share for child in root.children) == pytest.approx(sum(shares))
    assert [child.share for child in pieces] == pytest.approx([shares[0] / 2.0] * 2)
    assert sorted(child.doubted for child in pieces) == [0, node.doubted or 2 * int(told.sum())]
    size = root.squeeze.clusters.size
    assert size / size.sum() == pytest.approx(
        np.array([child.share for child in root.children]) / sum(shares), abs=0.01
    )


def test_no_two_nodes_have_one_name_after_branches_were_added(growth):
    late, root, node = late_tree(growth)
    node.alternatives = [Action(placed(TELLING))]
    improve(root, late, [1])
    assert len(root.children) == 3
    paths = [node.path for node in breadth_first(root)]
    assert len(set(paths)) == len(paths)
