"""Policy improvement by roll-out (Bertsekas, Dynamic Programming and Optimal Control, vol. 1, ch. 6).

A look-ahead of two squeezes estimates what comes after them. Here the alternatives of the nodes that most
parts pass are grown by the same search until only small leaves are open, and the cheapest subtree stays; so
are those nodes' readings told apart, each piece with a squeeze of its own (decision 0046).
"""

import math
from collections.abc import Callable

import numpy as np

from planner.arrays import IntArray
from planner.belief.particles import Belief
from planner.search.actions import Action
from planner.search.expand import (
    Growth,
    Progress,
    TreeNode,
    breadth_first,
    grow,
    replace_child,
    squeeze_at,
    untold,
)
from planner.search.hasty import price


def improve(
    root: TreeNode,
    growth: Growth,
    seed: list[int],
    progress: Progress = untold,
    out_of_time: Callable[[], bool] = lambda: False,
    rough: float = 0.0,
) -> None:
    """Tries the alternatives of the root, then those of the nodes that one or two squeezes lead to.

    Args:
        root: a tree of which all such nodes have a squeeze, modified in place.
        growth: how it was grown.
        seed: every alternative draws from a stream of its own, named after it and its node's path.
        progress: called with the number of alternatives tried and the number to try.
        out_of_time: asked before each alternative, and while it grows: one not grown to its end is dropped.
        rough: share of a node, of which leaves that locate all but less are not grown to compare subtrees.
    """
    params = growth.objective.params
    for k, action in enumerate(root.alternatives):
        other, limit = TreeNode(root.belief, root.share, root.mode), price(root, growth)
        _grown(other, other, None, action, limit, growth, [*seed, k + 1], out_of_time, rough)
        if not out_of_time() and price(other, growth) < limit:
            root.squeeze, root.children, root.named = other.squeeze, other.children, other.named
    for depth, saving in params.improved_savings:
        inner = [node for node in breadth_first(root) if node.children]
        pairs = [(child, node) for node in inner for child in node.children if child.depth == depth]
        pairs = [(child, node) for child, node in pairs if child.share >= params.improved_share]
        for done, (node, parent) in enumerate(pairs):
            progress(done, len(pairs) - done)
            grow(node, growth, seed, out_of_time=out_of_time, least=rough * node.share)
            tried, left = node.alternatives, (1.0 + saving) * growth.objective.costs.least
            pieces = _cheapest(node, parent, left, growth, seed, out_of_time, rough)
            pieces = _told_apart(pieces, parent, left, growth, seed, out_of_time, rough)
            max(pieces, key=lambda piece: piece.share).alternatives = tried  # leaves below may fail later


def mend(
    root: TreeNode,
    growth: Growth,
    seed: list[int],
    fails: Callable[[TreeNode], bool],
    out_of_time: Callable[[], bool] = lambda: False,
) -> bool:
    """Tries the alternatives above leaves that fail, the nearest node's first, each node's once.

    Args:
        root: a grown tree, modified in place.
        growth: how it was grown; the alternatives are grown to their end.
        seed: as of `improve`.
        fails: whether a leaf stays unresolved however the tree grows.
        out_of_time: asked before each alternative, and while it grows: one not grown to its end is dropped.

    Returns:
        Whether the tree was changed.
    """
    changed = False
    while not out_of_time() and (pair := _above_failure(root, fails)):
        pieces = _cheapest(*pair, growth.objective.costs.least, growth, seed, out_of_time, 0.0)
        changed |= pieces[0] is not pair[0]
        pair[0].alternatives = []
    return changed


def _above_failure(root: TreeNode, fails: Callable[[TreeNode], bool]) -> tuple[TreeNode, TreeNode] | None:
    """The nearest node with alternatives above a leaf that fails, the root excepted, and its parent."""
    nodes = breadth_first(root)
    parents = {id(child): node for node in nodes for child in node.children}
    for leaf in nodes:
        node = leaf
        while node is not root and not (node.children and node.alternatives):
            node = parents[id(node)]
        if not leaf.children and node is not root and fails(leaf):
            return node, parents[id(node)]
    return None


def _cheapest(
    node: TreeNode, parent: TreeNode, left: float, growth: Growth, seed: list[int],
    out_of_time: Callable[[], bool], rough: float,
) -> list[TreeNode]:  # fmt: skip
    """Puts the cheapest of a node's alternatives in its place if that is cheaper; returns what stands there.

    None is tried where the node costs no more than `left` a part.
    """
    pieces = [node]
    for k, action in enumerate(node.alternatives):
        before = sum(price(piece, growth) for piece in pieces)
        if out_of_time() or before < left * sum(piece.share for piece in pieces):
            break
        other = _other(pieces, parent, action, before, growth, [*seed, k + 1], out_of_time, rough)
        if not out_of_time() and price(other, growth) < before:
            pieces = _replaced(pieces, parent, other)
    return pieces


def _replaced(pieces: list[TreeNode], parent: TreeNode, other: TreeNode) -> list[TreeNode]:
    """Puts the children of a parent's stand-in where some of its own stand that hold the same parts."""
    for piece in pieces[1:]:
        parent.children.remove(piece)
    replace_child(parent, pieces[0], other.children)
    parent.named = other.named
    return other.children


def _told_apart(
    pieces: list[TreeNode], parent: TreeNode, left: float, growth: Growth, seed: list[int],
    out_of_time: Callable[[], bool], rough: float,
) -> list[TreeNode]:  # fmt: skip
    """As `_cheapest`, with the readings cut as finely as they hold parts enough, each piece for itself.

    Which readings stay together was decided before anything was known of the squeezes that follow.
    """
    params = growth.objective.params
    belief, share = Belief.joined([piece.belief for piece in pieces]), sum(piece.share for piece in pieces)
    before = sum(price(piece, growth) for piece in pieces)
    starts = _starts(belief.reading, params.piece_particles)
    if out_of_time() or before < left * share or len(starts) + 1 < params.least_pieces:
        return pieces
    label = np.searchsorted(starts, belief.reading, side="right")
    numbers = range(len(starts), -1, -1)  # the widest first: counts fall as widths rise
    parts = [((*parent.path, parent.named + k), belief[label == k]) for k in numbers]
    stand = _stand(pieces, parent, parts, growth)
    stand.named += len(parts)
    most = (1.0 - params.piece_saving) * before

    def too_dear() -> bool:
        begun = all(piece.children or math.isfinite(piece.exhausted) for piece in stand.children)
        return out_of_time() or (begun and price(stand, growth) >= most)

    grow(stand, growth, [*seed, 0], out_of_time=too_dear, least=rough * share)
    return _replaced(pieces, parent, stand) if not out_of_time() and price(stand, growth) < most else pieces


def _starts(reading: IntArray, least: int) -> IntArray:
    """The first counts of all pieces but the lowest: each has at least so many of the readings (n,)."""
    counts, size = np.unique(reading, return_counts=True)
    starts, held = list[int](), 0
    for count, readings in zip(counts.tolist(), size.tolist(), strict=True):
        if held >= least:
            starts.append(count)
            held = 0
        held += readings
    return np.array(starts[: len(starts) - (held < least)], np.int64)


def _other(
    pieces: list[TreeNode], parent: TreeNode, action: Action, limit: float, growth: Growth, seed: list[int],
    out_of_time: Callable[[], bool], rough: float,
) -> TreeNode:  # fmt: skip
    """A parent's stand-in, its one child squeezed elsewhere and grown."""
    belief = Belief.joined([piece.belief for piece in pieces])
    stand = _stand(pieces, parent, [(pieces[0].path, belief)], growth)
    _grown(stand.children[0], stand, stand, action, limit, growth, seed, out_of_time, rough)
    return stand


def _stand(
    pieces: list[TreeNode], parent: TreeNode, parts: list[tuple[tuple[int, ...], Belief]], growth: Growth
) -> TreeNode:
    """A parent's stand-in: its children have the paths and beliefs stated, and no squeeze yet."""
    whole, share = Belief.joined([belief for _, belief in parts]), sum(piece.share for piece in pieces)
    stand = TreeNode(whole, 0.0, pieces[0].mode, parent.path, squeeze=parent.squeeze, named=parent.named)
    for path, belief in parts:
        mode, vain = growth.objective.metric.mode(belief.states), pieces[0].squeezes_without_gain
        stand.children.append(TreeNode(belief, share * (len(belief) / len(whole)), mode, path, vain))
    return stand


def _grown(
    node: TreeNode, tree: TreeNode, parent: TreeNode | None, action: Action, limit: float, growth: Growth,
    seed: list[int], out_of_time: Callable[[], bool], rough: float,
) -> None:  # fmt: skip
    """Takes an action, and grows the tree that the node is of unless it seems to cost too much."""
    squeeze_at(node, parent, action, growth, np.random.default_rng([*seed, *node.path]))
    most = limit + growth.objective.params.dearer * growth.objective.costs.least * node.share
    grow(
        tree, growth, seed, out_of_time=lambda: out_of_time() or price(tree, growth) >= most,
        least=rough * node.share,
    )  # fmt: skip
