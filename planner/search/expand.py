"""Growing the tree: Algorithm 1 of the paper, with the action chosen by closed-loop look-ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from planner.arrays import Array
from planner.belief import replenish
from planner.goal import Mode
from planner.models.partition import Partition
from planner.search.closed_loop import LookAhead

LEAST_PARTICLES = 100
"""A belief thinner than this is repeated before its next squeeze."""

Progress = Callable[[int, int], None]


@dataclass(slots=True, eq=False)
class TreeNode:
    """A node of the plan: a belief, and either an action with its outcomes or a predicted pose.

    Attributes:
        belief: (n, 3) particles in the world.
        share: probability of getting here.
        depth: squeezes made so far.
        mode: the pose that explains most of the belief.
        placement: (3,) the hand frame to squeeze at; None at a leaf.
        clearance_mm: least distance between the open fingers there and the believed part.
        clusters: the partition of the outcomes.
        children: one node for each cluster.
    """

    belief: Array
    share: float
    depth: int
    mode: Mode
    placement: Array | None = None
    clearance_mm: float = 0.0
    clusters: Partition | None = None
    children: list[TreeNode] = field(default_factory=list)


def root_of(belief: Array, look_ahead: LookAhead) -> TreeNode:
    """A tree of one node."""
    return TreeNode(belief, 1.0, 0, look_ahead.metric.mode(belief))


def breadth_first(root: TreeNode) -> list[TreeNode]:
    """All nodes, the root first: the order in which a table numbers them."""
    order, waiting = [], deque([root])
    while waiting:
        node = waiting.popleft()
        order.append(node)
        waiting.extend(node.children)
    return order


def grow(
    root: TreeNode, look_ahead: LookAhead, max_depth: int, seed: list[int], progress: Progress | None = None
) -> None:
    """Expands the tree's leaves breadth first until each meets the goal or nothing gains any more.

    Args:
        root: the tree, modified in place.
        look_ahead: chooses the actions.
        max_depth: longest path [squeezes].
        seed: every node draws from a stream of its own, numbered in order of expansion.
        progress: called with the number of nodes done and the number waiting.
    """
    waiting = deque(node for node in breadth_first(root) if not node.children)
    done = 0
    while waiting:
        node = waiting.popleft()
        done += 1
        if node.mode.ratio < look_ahead.confidence and node.depth < max_depth:
            _expand(node, look_ahead, np.random.default_rng([*seed, done]))
            waiting.extend(node.children)
        if progress is not None:
            progress(done, len(waiting))


def learn(root: TreeNode, beliefs: dict[int, Array], look_ahead: LookAhead) -> int:
    """Gives leaves the larger beliefs that an evaluation found there.

    Args:
        root: the tree, modified in place.
        beliefs: poses (n, 3) by the leaf's number, breadth first.
        look_ahead: knows the goal.

    Returns:
        The number of leaves that no longer meet the goal.
    """
    short = 0
    leaves = [node for node in breadth_first(root) if not node.children]
    for number, node in enumerate(leaves):
        poses = beliefs.get(number)
        if poses is None or len(poses) <= len(node.belief):
            continue
        met = node.mode.ratio >= look_ahead.confidence
        node.belief, node.mode = poses, look_ahead.metric.mode(poses)
        short += met and node.mode.ratio < look_ahead.confidence
    return short


def _expand(node: TreeNode, look_ahead: LookAhead, rng: np.random.Generator) -> None:
    """Chooses the node's action and adds a child for each cluster of outcomes."""
    placement, _ = look_ahead.best_action(node.belief, rng)
    if placement is None:
        return
    node.placement = placement
    node.clearance_mm = look_ahead.clearance(node.belief, placement)
    belief = replenish(node.belief, LEAST_PARTICLES)
    outcomes = look_ahead.model.squeeze([(belief, placement)], rng)[0]
    node.clusters = outcomes.clusters
    for share, child in zip(outcomes.probability, outcomes.beliefs, strict=True):
        mode = look_ahead.metric.mode(child)
        node.children.append(TreeNode(child, node.share * float(share), node.depth + 1, mode))
