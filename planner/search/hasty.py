"""Trees grown in a fraction of the time: what a first squeeze is worth, and plans within a budget.

J of a first squeeze says little of what it costs: two squeezes ahead hardly any part is located. A whole tree
does, grown with a fifth of the particles and one squeeze of look-ahead (decision 0043).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.search.expand import Growth, TreeNode, grow, squeeze_at
from planner.search.improve import price
from planner.search.ranking import unlike

HASTY_PARTICLES = 5  # A hasty tree's beliefs have the job's particles, divided by this
HASTY_SEARCH = 4  # Its look-ahead, which is of one squeeze, has the job's search particles, divided by this
SEED_FIRST = 0x46495253


def hasty_root(root: TreeNode) -> TreeNode:
    """The root of a hasty tree: the same belief with fewer particles."""
    few = subsample(root.belief, max(1, len(root.belief) // HASTY_PARTICLES))
    return TreeNode(few, root.share, root.mode)


def hasty_growth(growth: Growth) -> Growth:
    """The same growth with little effort."""
    look_ahead = growth.look_ahead
    few = max(1, look_ahead.particles // HASTY_SEARCH)
    return replace(growth, look_ahead=replace(look_ahead, depth=1, particles=few))


def squeeze_first(
    root: TreeNode, growth: Growth, seed: list[int], out_of_time: Callable[[], bool] = lambda: False
) -> None:
    """Squeezes the root where hasty trees cost least; leaves it as it is where there is nothing to choose.

    Each candidate has a tree; those that cost little more than the cheapest have another, whose cost is added.

    Args:
        root: without a squeeze, modified in place.
        growth: how the tree will be grown.
        seed: every hasty tree draws from a stream of its own.
        out_of_time: asked before each node.
    """
    placements = _candidates(root, growth, seed)
    close = growth.objective.params.first_close * growth.objective.costs.least
    cost, left = np.zeros(len(placements)), list(range(len(placements)))
    for attempt in range(2):
        least = np.inf
        for k in left if len(left) > 1 else []:
            most = least + close - cost[k]
            own = [*seed, SEED_FIRST, attempt, k]
            cost[k] += _cost(root, placements[k], growth, own, most, out_of_time)
            least = min(least, cost[k])
        left = [k for k in left if cost[k] < least + close]
    if len(placements) > 1 and not out_of_time():
        best = min(left, key=lambda k: float(cost[k]))
        squeeze_at(root, None, placements[best], growth, np.random.default_rng([*seed, SEED_FIRST]))


def _candidates(root: TreeNode, growth: Growth, seed: list[int]) -> Array:
    """First squeezes (k, 3), no two nearly the same; those about the middle first, or the most promising."""
    ranking, params, belief = growth.look_ahead.ranking, growth.objective.params, root.belief
    if ranking.actions.first is None:
        rng = np.random.default_rng([*seed, SEED_FIRST])
        choices = growth.look_ahead.choose(belief, rng, params.first_candidates)
        return np.array([choice.placement for choice in choices])
    placements = ranking.candidates(belief, belief)
    compared = ranking.actions.compared(placements, belief.squeezed)
    order = np.argsort(np.hypot(*compared[:, :2].T).round(6), kind="stable")
    return placements[order[unlike(compared[order], params.first_candidates, params)]]


def _cost(
    root: TreeNode, placement: Array, growth: Growth, seed: list[int], most: float,
    out_of_time: Callable[[], bool],
) -> float:  # fmt: skip
    """Price of a hasty tree with this first squeeze; it grows no further where it costs more than `most`."""
    tree, little = hasty_root(root), hasty_growth(growth)
    squeeze_at(tree, None, placement, little, np.random.default_rng(seed))
    least = growth.objective.params.improved_share
    grow(
        tree, little, seed, least=least,
        out_of_time=lambda: out_of_time() or price(tree, little) >= most,
    )  # fmt: skip
    return price(tree, little)
