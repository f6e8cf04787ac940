"""Trees grown in a fraction of the time: what a first squeeze costs, and plans within a budget.

J of a first squeeze says little of its cost: two squeezes ahead hardly any part is located. A whole tree
does, grown with a fifth of the particles and one squeeze of look-ahead (decision 0043).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.search.actions import Action
from planner.search.expand import Growth, Progress, TreeNode, breadth_first, grow, squeeze_at, untold
from planner.search.ranking import unlike

HASTY_PARTICLES = 5  # A hasty tree's beliefs have the job's particles, divided by this
HASTY_SEARCH = 4  # Its look-ahead, which is of one squeeze, has the job's search particles, divided by this
ROUNDS = 2  # Trees of each first squeeze that may be the cheapest
SEED_COST = 0x434F5354
SEED_HASTY = 0x48415354
SEED_FIRST = 0x46525354


def hasty_root(root: TreeNode) -> TreeNode:
    """The root of a hasty tree: the same belief with fewer particles."""
    few = subsample(root.belief, max(1, len(root.belief) // HASTY_PARTICLES))
    return TreeNode(few, root.share, root.mode)


def hasty_growth(growth: Growth) -> Growth:
    """The same growth with little effort."""
    look_ahead = growth.look_ahead
    few = max(1, look_ahead.particles // HASTY_SEARCH)
    pusher = growth.pusher and replace(growth.pusher, sparing=True)
    return replace(growth, look_ahead=replace(look_ahead, depth=1, particles=few), pusher=pusher)


def grow_hastily(
    root: TreeNode, growth: Growth, seed: list[int], progress: Progress,
    out_of_time: Callable[[], bool], reopen: float = 1.0,
) -> None:  # fmt: skip
    """`grow` with little effort; where that gains nothing, a leaf stays open to more."""
    before = {node.path: (node.exhausted, node.searched) for node in breadth_first(root)}
    grow(root, hasty_growth(growth), [*seed, SEED_HASTY], progress, out_of_time, reopen)
    for node in breadth_first(root):
        node.exhausted, node.searched = before.get(node.path, (math.inf, 0))


def squeeze_first(
    root: TreeNode,
    growth: Growth,
    seed: list[int],
    progress: Progress = untold,
    out_of_time: Callable[[], bool] = lambda: False,
) -> None:
    """Squeezes the root where hasty trees cost least; leaves it as it is where there is nothing to choose.

    The next best stays an alternative where the trees do not decide between the two.

    Args:
        root: without a squeeze, modified in place.
        growth: how the tree will be grown.
        seed: every hasty tree draws from a stream of its own.
        progress: called with the number of hasty trees done and the number waiting.
        out_of_time: asked before each node.
    """
    actions = _candidates(root, growth, np.random.default_rng([*seed, SEED_FIRST]))
    if len(actions) < 2:
        return
    found = costs(root, actions, growth, seed, progress, out_of_time)
    if not out_of_time():
        best, second = np.argsort(found, kind="stable")[:2]
        squeeze_at(root, None, actions[best], growth, np.random.default_rng([*seed, SEED_COST]))
        undecided = growth.objective.params.undecided * growth.objective.costs.least
        root.alternatives = [actions[second]] if found[second] < found[best] + undecided else []


def costs(
    root: TreeNode, actions: Sequence[Action], growth: Growth, seed: list[int], progress: Progress,
    out_of_time: Callable[[], bool],
) -> Array:  # fmt: skip
    """What k first actions cost: the mean price of their hasty trees.

    Returns:
        (k,) as probabilities of success; infinite where a tree costs clearly more than the cheapest.
    """
    close = growth.objective.params.close * growth.objective.costs.least
    total, left, trees = np.zeros(len(actions)), list(range(len(actions))), 0
    while trees < ROUNDS and (len(left) > 1 or not trees):
        least = np.inf
        for done, k in enumerate(left):
            progress(done + trees * len(actions), len(left) - done)
            most = least + close - total[k]
            total[k] += _cost(root, actions[k], growth, [*seed, SEED_COST, trees, k], most, out_of_time)
            least = min(least, total[k])
        left, trees = [k for k in left if total[k] < least + close], trees + 1
    found = np.full(len(actions), np.inf)
    found[left] = total[left] / trees
    return found


def _cost(
    root: TreeNode, action: Action, growth: Growth, seed: list[int], most: float,
    out_of_time: Callable[[], bool],
) -> float:  # fmt: skip
    """Price of one hasty tree; it grows no further where it costs more than `most`."""
    tree, little = hasty_root(root), hasty_growth(growth)
    squeeze_at(tree, None, action, little, np.random.default_rng(seed))
    grow(
        tree, little, seed, least=growth.objective.params.improved_share,
        out_of_time=lambda: out_of_time() or price(tree, little) >= most,
    )  # fmt: skip
    return price(tree, little)


def _candidates(root: TreeNode, growth: Growth, rng: np.random.Generator) -> list[Action]:
    """First actions of parts that lie at any angle: squeezes, no two nearly alike, then some after pushes.

    The middle's squeezes come first. None where the angle is known about: such parts are located within the
    look-ahead, and J tells more.
    """
    ranking, params, belief = growth.look_ahead.ranking, growth.objective.params, root.belief
    if ranking.actions.first is None:
        return []
    placements = ranking.candidates(belief, belief)
    compared = ranking.actions.compared(placements, belief.touched)
    order = np.argsort(np.hypot(*compared[:, :2].T).round(6), kind="stable")
    found = [Action(placements[order[k]]) for k in unlike(compared[order], params.first_candidates, params)]
    if growth.pusher is not None:
        found += growth.pusher.first(belief, hasty_growth(growth).look_ahead, rng)
    return found


def price(node: TreeNode, growth: Growth) -> float:
    """What a subtree costs, as a probability of success: its squeezes, and the parts it does not locate.

    A leaf that may be grown further costs J. Any other that misses the goal stays unresolved and counts as
    a failure of all its parts. The mass outside its mode is added, so that of two such leaves the one that
    knows more is better.
    """
    squeezes, lost, objective = 0.0, 0.0, growth.objective
    for each in breadth_first(node):
        if each.squeeze is not None:
            squeezes += each.cost
            lost += each.share * each.squeeze.crashes
        elif growth.worth_growing(each, objective.confidence):
            size = np.array([len(each.belief)])
            squeezes += each.share * float(objective.rule.estimate.squeezes(each.mode.ratio * size, size)[0])
        else:
            short = each.mode.ratio < objective.confidence
            lost += each.unlocated_mass + each.share * short
    return objective.costs.least * squeezes + lost
