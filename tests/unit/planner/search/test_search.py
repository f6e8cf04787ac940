"""The search equals exhaustive enumeration in toy worlds, and its trees keep their invariants."""

import itertools
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
import pytest
from rectangle import JOB_PATH

from planner.belief.particles import Belief
from planner.belief.transition import Squeezed
from planner.frames import wrap
from planner.job import model as job_file
from planner.mechanics.mixture import Mixture
from planner.problem import Problem
from planner.search.effort import PASSES
from planner.search.search import LEAST_STRAYS, Search
from planner.search.tree import Node, breadth_first, leaves

WITHIN = {"orientation": "within", "orientation_halfwidth_deg": 20}
CHANGES = {"actions": {"angles_deg": [0, 50, 100]}, "uncertainty": WITHIN}
JOB = job_file.load(JOB_PATH, CHANGES)
ANGLES = np.radians(JOB.actions.angles_deg)
PLACES = np.array([[-12.0, 0.0, 0.0], [-4.0, 8.0, 0.0], [4.0, -8.0, 0.0], [12.0, 0.0, 0.0]])
EACH = 100  # particles at each place


@dataclass(frozen=True)
class Toy:
    """A world in which parts do not move; the angle of the squeeze and the part's place give the reading."""

    simulator: Mixture
    counts: np.ndarray  # (angles, places)

    def squeeze(self, cases, rng):
        squeezed = []
        for belief, grasp in cases:
            off = belief.poses[:, None, :2] - PLACES[:, :2]
            place = np.argmin(np.linalg.norm(off, axis=2), axis=1)
            angle = int(np.argmin(np.abs(wrap(ANGLES - grasp[2], 2))))
            squeezed.append(Squeezed(replace(belief, reading=self.counts[angle][place]), 40.0))
        return squeezed

    def squeeze_at_each(self, belief, grasps, rng):
        after = [each.belief for each in self.squeeze([(belief, grasp) for grasp in grasps], rng)]
        return np.stack([each.poses for each in after]), np.stack([each.reading for each in after])


def least_squeezes(counts, places):
    """The fewest expected squeezes that tell equally likely places apart; infinite if no squeezes do."""
    if len(places) == 1:
        return 0.0
    best = np.inf
    for row in counts:
        groups = [[p for p in places if row[p] == count] for count in {row[p] for p in places}]
        if len(groups) > 1:
            rest = sum(len(group) * least_squeezes(counts, group) for group in groups) / len(places)
            best = min(best, 1.0 + rest)
    return best


CURSORY, FIRST, EXPLORING, *_ = PASSES


def searched(problem, belief):
    search = Search(problem, np.random.default_rng(1), FIRST)
    root = Node(belief, 1.0, problem.metric.mode(belief.states))
    root.value = search.leaf_value(root)
    for stage in (FIRST, EXPLORING):
        if stage.explores:
            assert search.begin(stage, root) is root
        assert search.grow(root, lambda: False, lambda _: None)
    return search, root


def squeezes(root):
    """The expected number of squeezes of a plan, from its root."""
    return sum(node.share for node in breadth_first(root) if node.children)


@pytest.fixture(scope="module")
def problem():
    return Problem.of(JOB, 1)


@pytest.fixture(scope="module")
def tree(problem):
    """A finished search and the root of its tree, grown from simulated squeezes."""
    belief = problem.belief(500, np.random.default_rng(2))
    return searched(problem, belief)


def worlds():
    """Seeds and counts (angles, places) of toy worlds whose places can be distinguished."""
    for seed in itertools.count():
        counts = 90 + 40 * np.random.default_rng(seed).integers(0, 3, (len(ANGLES), len(PLACES)))
        if np.isfinite(least_squeezes(counts, range(len(PLACES)))):
            yield seed, counts


@pytest.mark.parametrize(("seed", "counts"), list(itertools.islice(worlds(), 10)))
def test_grow_toy_world_reaches_the_optimum_of_exhaustive_search(problem, seed, counts):
    toy = Toy(problem.mixture, counts)
    belief = Belief.of(np.repeat(PLACES, EACH, axis=0))
    _, root = searched(replace(problem, model=toy, ahead=toy), belief)
    assert squeezes(root) == pytest.approx(least_squeezes(counts, range(len(PLACES))))
    assert all(problem.stopping.reached(leaf.mode.ratio) for leaf in leaves(root))


def of_places_that_read_alike(max_depth):
    """A problem in which all places but the first read alike, and the root of its tree."""
    problem = Problem.of(JOB.replaced(search={"max_depth": max_depth}), 1)
    counts = np.full((len(ANGLES), len(PLACES)), 100)
    counts[:, 0] = 180
    toy = Toy(problem.mixture, counts)
    belief = Belief.of(np.repeat(PLACES, EACH, axis=0))
    return problem, searched(replace(problem, model=toy, ahead=toy), belief)[1]


def test_grow_places_that_read_alike_ends_in_an_unresolved_leaf():
    problem, root = of_places_that_read_alike(max_depth=2)
    known = [leaf for leaf in leaves(root) if problem.stopping.reached(leaf.mode.ratio)]
    assert sum(leaf.share for leaf in known) == pytest.approx(0.25)
    assert max(node.depth for node in breadth_first(root)) == 2


def test_grow_real_squeezes_turns_the_hand_by_a_quarter_turn_at_most(tree):
    _, root = tree
    for node in breadth_first(root):
        for action in node.actions or ():
            if node.hand is not None:
                turn = action.squeeze.placement[2] - node.hand.placement[2]
                assert abs(turn) <= np.pi / 2 + 1e-9


def test_grow_places_that_read_alike_follows_one_useless_squeeze():
    _, root = of_places_that_read_alike(max_depth=8)
    nodes = [root]
    for node in nodes:  # grows while it is walked
        actions = node.actions or []
        nodes += [child for action in actions for child in action.children]
        assert sum(action.children[0].stalled > 0 for action in actions) <= 1
    assert max(node.stalled for node in nodes) > 0


def test_grow_real_squeezes_conserves_probability_and_particles(tree):
    _, root = tree
    for node in breadth_first(root):
        for action in node.actions or ():
            shares = sum(child.share for child in action.children)
            assert shares == pytest.approx(node.share * (1.0 - action.squeeze.crashes), rel=1e-9)
            readings = [set(child.belief.reading.tolist()) for child in action.children]
            assert sum(map(len, readings)) == len(set().union(*readings))


def test_back_up_real_squeezes_satisfies_the_bellman_equation(tree, problem):
    _, root = tree
    for node in breadth_first(root):
        if not node.actions:
            continue
        for action in node.actions:
            shares = np.array([child.share for child in action.children])
            left = shares @ [child.value for child in action.children] / shares.sum()
            crashes = action.squeeze.crashes
            left = crashes * problem.stopping.failure + (1.0 - crashes) * left
            value = action.squeeze.cost + left
            assert action.value == pytest.approx(value)
        assert node.value == pytest.approx(min(action.value for action in node.actions))
        assert node.best is node.actions[0]


def test_begin_exploring_pass_ignores_values_of_the_cursory_pass(problem):
    search = Search(problem, np.random.default_rng(1))
    frugal = search.begin(CURSORY, None)
    assert search.grow(frugal, lambda: False, lambda _: None)
    for action in frugal.actions:
        for child in action.children:
            child.value = 2.5  # as if the second squeezes tried were poor
    root = search.begin(FIRST, frugal)
    assert search.grow(root, lambda: False, lambda _: None)
    search.begin(EXPLORING, root)
    again = [child for action in root.actions for child in action.children if child.previous]
    assert again
    assert not [child for child in again if search.is_open(child) and child.value > 1.0]


def test_close_exploring_pass_cut_short_leaves_the_finished_plan(problem):
    _, counts = next(worlds())
    toy = Toy(problem.mixture, counts)
    search = Search(replace(problem, model=toy, ahead=toy), np.random.default_rng(1), FIRST)
    belief = Belief.of(np.repeat(PLACES, EACH, axis=0))
    root = Node(belief, 1.0, problem.metric.mode(belief.states))
    assert search.grow(root, lambda: False, lambda _: None)
    finished, value = {id(node) for node in breadth_first(root)}, root.value
    search.begin(EXPLORING, root)
    assert not search.grow(root, lambda: True, lambda _: None)
    assert not finished.issuperset(map(id, leaves(root)))
    assert search.close(root)
    assert finished.issuperset(map(id, leaves(root)))
    assert root.value == pytest.approx(value)


def test_reopen_dead_end_is_searched_again(problem):
    search = Search(problem, np.random.default_rng(1), FIRST)
    root = search.begin(FIRST, None)
    assert search.grow(root, lambda: False, lambda _: None)
    node = next(node for node in breadth_first(root) if node.depth and node.children)
    node.actions = []
    assert not search.is_open(node)
    search.reopen(root)
    assert search.is_open(node)
    assert search.grow(root, lambda: False, lambda _: None)
    assert node.children


def test_grow_spent_limit_leaves_a_whole_plan_of_one_squeeze(problem):
    search = Search(problem, np.random.default_rng(1), FIRST)
    belief = problem.belief(500, np.random.default_rng(2))
    root = Node(belief, 1.0, problem.metric.mode(belief.states))
    assert not search.grow(root, lambda: True, lambda _: None)
    assert root.children
    assert not any(child.children for child in root.children)


def test_absorb_parts_beside_a_leaf_pose_reopens_it(tree):
    search, root = deepcopy(tree)
    ends = leaves(root)
    number = max(range(len(ends)), key=lambda k: ends[k].share)
    leaf, size = ends[number], len(ends[number].belief)
    few = size // 4
    beside = np.tile(leaf.mode.pose + np.array([30.0, 0.0, 0.0]), (few, 1))
    more = Belief.of(beside, np.full(few, leaf.belief.reading[0]))
    again = search.absorb(root, {number: more}, {})
    assert again == pytest.approx(leaf.share)
    assert search.is_open(leaf)
    assert (len(leaf.belief), leaf.fresh) == (size + few, few)


def test_absorb_parts_at_a_leaf_pose_leaves_the_plan_as_it_is(tree, problem):
    search, root = deepcopy(tree)
    before = squeezes(root)
    ended = {
        k: Belief.of(np.tile(leaf.mode.pose, (150, 1)), np.full(150, leaf.belief.reading[0]))
        for k, leaf in enumerate(leaves(root))
        if problem.stopping.reached(leaf.mode.ratio)
    }
    assert search.absorb(root, ended, {}) == 0.0
    assert squeezes(root) == before


def read_at(root, count, size):
    """`size` particles at the pose of the root's first child, all of which read `count`."""
    return Belief.of(np.tile(root.children[0].mode.pose, (size, 1)), np.full(size, count))


@pytest.mark.parametrize("size", [LEAST_STRAYS - 1, LEAST_STRAYS])
def test_absorb_enough_strays_far_from_branches_form_a_new_one(tree, size):
    search, root = deepcopy(tree)
    children, far = len(root.children), int(root.squeeze.clusters.low[-1]) - 40
    search.absorb(root, {}, {0: read_at(root, far, size)})
    assert len(root.children) == children + (size >= LEAST_STRAYS)
    assert (far in root.squeeze.clusters.low) == (size >= LEAST_STRAYS)
    held = sum(child.share for child in root.children)
    assert held == pytest.approx(1.0, abs=size / len(root.belief))
