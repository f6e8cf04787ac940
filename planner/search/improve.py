"""Improving a tree: other squeezes for the nodes that most parts pass, each with all that follows it.

A look-ahead of two squeezes guesses what comes after them. Here the most promising squeezes of a node are
followed to the end, each by the same search, and the cheapest plan stays: policy improvement by roll-out
(Bertsekas, Dynamic Programming and Optimal Control, vol. 1, ch. 6).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.arrays import Array
from planner.search.expand import Growth, Progress, TreeNode, breadth_first, grow, squeeze_at

DEPTHS = (2, 1)
"""Nodes are improved that so many squeezes lead to, the later first: what an earlier one leads to is then as
good as it gets. The first squeeze has nothing to go by."""
LEAST_SHARE = 0.03
"""Of the parts that must come to a node for it to be worth while."""
LEAST_TO_SAVE = 0.15
"""Squeezes a part beyond the one that it takes at least, likewise."""


def improve(
    root: TreeNode,
    growth: Growth,
    seed: list[int],
    progress: Progress | None = None,
    out_of_time: Callable[[], bool] = lambda: False,
) -> None:
    """Tries the alternatives of the nodes that one or two squeezes lead to.

    Args:
        root: a grown tree, modified in place.
        growth: how it was grown.
        seed: every alternative draws from a stream of its own, named after it and its node's path.
        progress: called with the number of alternatives tried and the number to try.
        out_of_time: asked before each alternative, and while it grows: one not grown to its end is dropped.
    """
    heavy = [node for node in breadth_first(root) if node.share >= LEAST_SHARE]
    nodes = [node for depth in DEPTHS for node in heavy if node.depth == depth]
    cases = [(node, k) for node in nodes for k in range(len(node.alternatives))]
    for done, (node, k) in enumerate(cases):
        if out_of_time():
            return
        if progress is not None:
            progress(done, len(cases) - done)
        if price(node, growth) < (1.0 + LEAST_TO_SAVE) * growth.look_ahead.costs.least * node.share:
            continue
        other = _other(node, node.alternatives[k], growth, [*seed, k + 1], out_of_time)
        if not out_of_time() and price(other, growth) < price(node, growth):
            node.become(other)


def _other(
    node: TreeNode, placement: Array, growth: Growth, seed: list[int], out_of_time: Callable[[], bool]
) -> TreeNode:
    """The node with another squeeze, grown until it is whole or certain to cost more."""
    other = TreeNode(node.belief, node.share, node.mode, node.path)
    limit = price(node, growth)
    squeeze_at(other, placement, growth, np.random.default_rng([*seed, *node.path]))
    grow(other, growth, seed, out_of_time=lambda: out_of_time() or bound(other, growth) >= limit)
    return other


def bound(node: TreeNode, growth: Growth) -> float:
    """What a subtree costs at least, however it is grown further: each leaf that is short needs a squeeze."""
    look_ahead = growth.look_ahead
    nodes = breadth_first(node)
    spent = sum(inner.share * inner.cost for inner in nodes if inner.children)
    short = sum(leaf.share for leaf in nodes if not leaf.children and leaf.mode.ratio < look_ahead.confidence)
    return look_ahead.costs.least * (spent + short)


def price(node: TreeNode, growth: Growth) -> float:
    """What a subtree costs, as a probability of success: its squeezes, and the parts it does not locate.

    A leaf that falls short of the goal will not say where its parts are: it loses all of them, and what it
    lacks once more, so that of two such leaves the one that knows more is better.
    """
    squeeze, confidence = growth.look_ahead.costs.least, growth.look_ahead.confidence
    nodes = breadth_first(node)
    leaves = [leaf for leaf in nodes if not leaf.children]
    spent = sum(inner.share * inner.cost for inner in nodes if inner.children)
    lost = sum(leaf.share for leaf in leaves if leaf.mode.ratio < confidence)
    return squeeze * spent + lost + sum(leaf.unlocated_mass for leaf in leaves)
