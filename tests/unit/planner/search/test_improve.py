"""Other squeezes for a node: the cheaper plan stays."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from oracle import BELIEF, SILENT, TELLING, Oracle, look_ahead

from planner.belief.particles import Belief
from planner.job import model as job_file
from planner.search.expand import Growth, TreeNode, grow, learn, squeeze_at
from planner.search.handling import handling_of
from planner.search.improve import bound, improve, price
from planner.search.params import SearchParams
from planner.search.ranking import squeezes_left

RECTANGLE = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"
PATIENT = 4
MOST_WITHOUT_GAIN = SearchParams().most_without_gain


@pytest.fixture(scope="module")
def growth():
    handling = handling_of(job_file.load(RECTANGLE))
    return Growth(look_ahead([SILENT, TELLING]), Oracle(), handling, PATIENT)


def placed(angle):
    return np.array([0.0, 0.0, angle])


def tree(growth, first, other):
    """A root, squeezed once without result, and a node that squeezes at an angle, with an alternative."""
    root = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    squeeze_at(root, placed(SILENT), growth, np.random.default_rng(0))
    (node,) = root.children
    node.squeezes_without_gain = 0  # else one more squeeze that tells nothing would be the last
    squeeze_at(node, placed(first), growth, np.random.default_rng(1))
    node.alternatives = [placed(other)]
    grow(node, growth, [1])
    return root, node


def test_a_squeeze_that_tells_at_once_takes_the_place_of_one_that_does_not(growth):
    root, node = tree(growth, SILENT, TELLING)
    before = price(root, growth)
    improve(root, growth, [1])
    assert node.squeeze.placement[2] == TELLING
    assert price(root, growth) == pytest.approx(before - growth.objective.costs.least)
    assert all(leaf.mode.ratio == 1.0 for leaf in node.children)


def test_parts_under_a_finger_count_and_are_failures(growth):
    """One part in twenty lies where the open finger comes down: its share is nobody's, and is paid for."""
    under = np.tile([0.0, 47.0, 0.0], (len(BELIEF) // 19, 1))
    belief = Belief.joined([BELIEF, Belief.of(under)])
    root = TreeNode(belief, 0.8, growth.objective.metric.mode(belief.poses))
    squeeze_at(root, placed(TELLING), growth, np.random.default_rng(0))
    crashes = len(under) / len(belief)
    assert root.squeeze.crashes == pytest.approx(crashes)
    assert crashes > 0.04
    assert sum(child.share for child in root.children) == pytest.approx(0.8 * (1.0 - crashes))
    paid = price(root, growth)
    root.squeeze = root.squeeze._replace(crashes=0.0)
    assert paid - price(root, growth) == pytest.approx(0.8 * crashes)


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
    short = TreeNode(nearly, 0.5, metric.mode(nearly.poses))
    assert short.mode.ratio == pytest.approx(0.95)
    assert price(short, growth) == pytest.approx(0.5 + 0.5 * 0.05)
    met = TreeNode(BELIEF[:1], 0.5, metric.mode(BELIEF[:1].poses))
    assert price(met, growth) == 0.0


def test_nodes_that_few_parts_come_to_are_left_alone(growth):
    root, node = tree(growth, SILENT, TELLING)
    node.share = 0.01
    improve(root, growth, [1])
    assert node.squeeze.placement[2] == SILENT


def test_a_tree_costs_its_squeezes_and_what_it_leaves_open(growth):
    root = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    assert price(root, growth) == pytest.approx(1.0 + 0.5)
    squeeze = growth.objective.costs.least
    assert bound(root, growth) == pytest.approx(squeeze)
    squeeze_at(root, placed(TELLING), growth, np.random.default_rng(0))
    assert price(root, growth) == bound(root, growth) == pytest.approx(squeeze)


def test_a_belief_that_squeezes_tell_nothing_about_is_left_after_some(growth):
    silent = Growth(look_ahead([TELLING]), Oracle(), growth.handling, 9)
    root = leaf = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    for squeezes_without_gain in range(1, MOST_WITHOUT_GAIN + 1):
        squeeze_at(leaf, placed(SILENT), silent, np.random.default_rng(0))
        (leaf,) = leaf.children
        assert leaf.squeezes_without_gain == squeezes_without_gain
    grow(root, silent, [1])
    assert leaf.children == []


def test_the_bound_never_exceeds_what_the_grown_tree_costs(growth):
    for first in (SILENT, TELLING):
        root = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
        squeeze_at(root, placed(first), growth, np.random.default_rng(0))
        before = bound(root, growth)
        grow(root, growth, [1])
        assert before <= price(root, growth) + 1e-12


def test_a_purer_belief_needs_fewer_squeezes_and_one_within_the_goal_none():
    ratio = np.linspace(0.0, 1.0, 101)
    left = squeezes_left(ratio, SearchParams())
    assert np.all(np.diff(left) < 0.0)
    assert left[-1] == 0.0
    assert np.all(left[:-2] > 0.5)
    assert squeezes_left(np.array([1.2]), SearchParams())[0] == 0.0


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
    assert learn(refuted, {0: BELIEF.poses}, growth, 0.4, against=[0]) == 1.0
    grow(refuted, growth, [1], reopen=0.4)
    assert len(refuted.children) == 2


def test_a_refuted_leaf_that_no_squeeze_improves_calls_for_no_further_attempt(growth):
    leaf = TreeNode(
        BELIEF,
        0.3,
        growth.objective.metric.mode(BELIEF.poses),
        squeezes_without_gain=MOST_WITHOUT_GAIN,
    )
    assert learn(leaf, {0: BELIEF.poses}, growth, 0.4, against=[0]) == 0.3
    grow(leaf, growth, [1], reopen=0.4)
    assert leaf.children == []
    assert learn(leaf, {0: BELIEF.poses}, growth, 0.4, against=[0]) == 0.0
    worse = np.tile(BELIEF.poses[:100], (4, 1)) + np.array([0.0, 30.0, 0.0])
    assert learn(leaf, {0: np.concatenate([worse, -worse])}, growth, 0.4, against=[0]) == 0.3


def test_nodes_that_two_squeezes_lead_to_are_improved_too(growth):
    root, node = tree(growth, SILENT, SILENT)
    (later,) = node.children
    later.children = []
    squeeze_at(later, placed(SILENT), growth, np.random.default_rng(2))
    node.alternatives, later.alternatives = [], [placed(TELLING)]
    improve(root, growth, [1])
    assert later.squeeze.placement[2] == TELLING
    assert all(leaf.mode.ratio == 1.0 for leaf in later.children)
