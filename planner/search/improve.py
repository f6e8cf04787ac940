"""Policy improvement by roll-out (Bertsekas, Dynamic Programming and Optimal Control, vol. 1, ch. 6).

A look-ahead of two squeezes estimates what comes after them. Here the alternatives of the nodes that most
parts pass are grown to the end by the same search, and the cheapest subtree stays.
"""

from collections.abc import Callable

import numpy as np

from planner.arrays import Array
from planner.belief.particles import Belief
from planner.search.expand import Growth, Progress, TreeNode, breadth_first, grow, replace_child, squeeze_at


def improve(
    root: TreeNode,
    growth: Growth,
    seed: list[int],
    progress: Progress | None = None,
    out_of_time: Callable[[], bool] = lambda: False,
) -> None:
    """Tries the alternatives of the root, then of the nodes that one or two squeezes lead to.

    Args:
        root: a grown tree, modified in place.
        growth: how it was grown.
        seed: every alternative draws from a stream of its own, named after it and its node's path.
        progress: called with the number of alternatives tried and the number to try.
        out_of_time: asked before each alternative, and while it grows: one not grown to its end is dropped.
    """
    params = growth.objective.params
    for k, placement in enumerate(root.alternatives):
        other = TreeNode(root.belief, root.share, root.mode)
        _grown(other, other, None, placement, price(root, growth), growth, [*seed, k + 1], out_of_time)
        if not out_of_time() and price(other, growth) < price(root, growth):
            root.squeeze, root.children, root.named = other.squeeze, other.children, other.named
    for depth, saving in params.improved_savings:
        inner = [node for node in breadth_first(root) if node.children]
        pairs = [(child, node) for node in inner for child in node.children if child.depth == depth]
        pairs = [(child, node) for child, node in pairs if child.share >= params.improved_share]
        cases = [(node, parent, k) for node, parent in pairs for k in range(len(node.alternatives))]
        current = {id(node): [node] for node, _ in pairs}
        for done, (node, parent, k) in enumerate(cases):
            if out_of_time():
                return
            if progress is not None:
                progress(done, len(cases) - done)
            pieces = current[id(node)]
            before = sum(price(piece, growth) for piece in pieces)
            share = sum(piece.share for piece in pieces)
            if before < (1.0 + saving) * growth.objective.costs.least * share:
                continue
            other = _other(pieces, parent, node.alternatives[k], before, growth, [*seed, k + 1], out_of_time)
            if not out_of_time() and price(other, growth) < before:
                for piece in pieces[1:]:
                    parent.children.remove(piece)
                replace_child(parent, pieces[0], other.children)
                parent.named = other.named
                current[id(node)] = other.children


def _other(
    pieces: list[TreeNode], parent: TreeNode, placement: Array, limit: float, growth: Growth, seed: list[int],
    out_of_time: Callable[[], bool],
) -> TreeNode:  # fmt: skip
    """A parent's stand-in, its one child squeezed elsewhere, grown until whole or certain to cost more."""
    metric = growth.objective.metric
    belief = Belief.joined([piece.belief for piece in pieces])
    node = TreeNode(
        belief,
        sum(piece.share for piece in pieces),
        metric.mode(belief.states),
        pieces[0].path,
        pieces[0].squeezes_without_gain,
    )
    stand = TreeNode(belief, 0.0, node.mode, parent.path, squeeze=parent.squeeze, children=[node])
    stand.named = parent.named
    _grown(node, stand, stand, placement, limit, growth, seed, out_of_time)
    return stand


def _grown(
    node: TreeNode, tree: TreeNode, parent: TreeNode | None, placement: Array, limit: float, growth: Growth,
    seed: list[int], out_of_time: Callable[[], bool],
) -> None:  # fmt: skip
    """Squeezes at a placement, and grows the tree that the node is of until whole or certain to cost more."""
    squeeze_at(node, parent, placement, growth, np.random.default_rng([*seed, *node.path]))
    grow(tree, growth, seed, out_of_time=lambda: out_of_time() or bound(tree, growth) >= limit)


def bound(node: TreeNode, growth: Growth) -> float:
    """Lower bound of a subtree's price, however it grows: each leaf that misses the goal needs a squeeze."""
    spent, short = _cost(node, growth)
    return growth.objective.costs.least * (spent + short)


def price(node: TreeNode, growth: Growth) -> float:
    """What a subtree costs, as a probability of success: its squeezes, and the parts it does not locate.

    A leaf that misses the goal stays unresolved and counts as a failure of all its parts. The mass outside
    its mode is added, so that of two such leaves the one that knows more is better.
    """
    spent, short = _cost(node, growth)
    unlocated = sum(leaf.unlocated_mass for leaf in breadth_first(node) if not leaf.children)
    return growth.objective.costs.least * spent + short + unlocated


def _cost(node: TreeNode, growth: Growth) -> tuple[float, float]:
    """Squeezes of a subtree, and the share of all parts in leaves that miss the goal, or under a finger."""
    nodes, confidence = breadth_first(node), growth.objective.confidence
    short = sum(leaf.share for leaf in nodes if not leaf.children and leaf.mode.ratio < confidence)
    short += sum(inner.share * inner.squeeze.crashes for inner in nodes if inner.squeeze)
    return sum(inner.cost for inner in nodes), short
