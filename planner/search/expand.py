"""Growing the tree: Algorithm 1 of the paper, with the action chosen by closed-loop look-ahead."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Metric, Mode
from planner.belief.observation import Partition
from planner.belief.particles import replenish, without_friction
from planner.belief.transition import MotionModel
from planner.search.closed_loop import LEAST_PROGRESS, LookAhead
from planner.search.handling import Handling
from planner.search.options import selection_bias

ALTERNATIVES = 3
"""Placements kept for a node besides the chosen one."""
MOST_WITHOUT_GAIN = 3
"""Squeezes in a row that may gain nothing: two or three may be needed to tell two poses apart."""
NEWS = 0.002
"""Mode ratio that an exhausted leaf must have lost before squeezes are looked for again."""
LEAST_PARTICLES = 100
"""A belief thinner than this is repeated before its next squeeze."""

Progress = Callable[[int, int], None]


@dataclass(slots=True, eq=False)
class TreeNode:
    """A node of the plan: a belief, and either an action with its outcomes or a predicted pose.

    Attributes:
        belief: (n, 4) particles in the world with their friction, (n, 3) in the paper's plans.
        share: probability of getting here.
        mode: the pose that explains most of the belief.
        path: which branch was taken at each squeeze on the way.
        placement: (3,) the hand frame to squeeze at; None at a leaf.
        opening_mm: opening of the jaws on the way down.
        clearance_mm: least distance between the open fingers there and the believed part.
        unstable: share of the outcomes that friction alone holds.
        release: (2,) where the hand opens after dragging a held part there; None: where it squeezed.
        clusters: the partition of the outcomes.
        cost: of the squeeze, in squeezes.
        refuted: fresh trials spoke against it, as a leaf.
        exhausted: mode ratio at which no squeeze gained anything or none was left; above 1 where none was
            looked for.
        squeezes_without_gain: how many just before this node got the belief no nearer the goal.
        alternatives: further placements (3,) that looked promising, the best first.
        children: one node for each cluster.
    """

    belief: Array
    share: float
    mode: Mode
    path: tuple[int, ...] = ()
    placement: Array | None = None
    opening_mm: float = 0.0
    clearance_mm: float = 0.0
    unstable: float = 0.0
    release: Array | None = None
    clusters: Partition | None = None
    cost: float = 0.0
    refuted: bool = False
    exhausted: float = math.inf
    squeezes_without_gain: int = 0
    alternatives: list[Array] = field(default_factory=list)
    children: list[TreeNode] = field(default_factory=list)

    @property
    def depth(self) -> int:
        """Squeezes made so far."""
        return len(self.path)

    @property
    def unlocated_mass(self) -> float:
        """Share of all parts that end here, if it is a leaf, and are not known to be where it says."""
        return self.share * (1.0 - self.mode.ratio)

    def worth_growing(self, reopen: float) -> bool:
        """Whether a leaf holds less than `reopen`, or is refuted, and that is news."""
        return (self.mode.ratio < reopen or self.refuted) and self.mode.ratio < self.exhausted - NEWS

    def become(self, other: TreeNode) -> None:
        """Takes over another node's squeeze and all that follows it."""
        for name in ("placement", "opening_mm", "clearance_mm", "unstable", "release", "clusters", "cost"):
            setattr(self, name, getattr(other, name))
        self.children = other.children


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """How a tree is grown.

    Attributes:
        look_ahead: chooses the actions.
        reference: squeezes the beliefs of the tree itself, whatever model the look-ahead uses.
        handling: what is decided about a squeeze once its placement is chosen.
        max_depth: longest path [squeezes].
    """

    look_ahead: LookAhead
    reference: MotionModel
    handling: Handling
    max_depth: int


def breadth_first(root: TreeNode) -> list[TreeNode]:
    """All nodes, the root first: the order in which a table numbers them."""
    order, waiting = [], deque([root])
    while waiting:
        node = waiting.popleft()
        order.append(node)
        waiting.extend(node.children)
    return order


def grow(
    root: TreeNode,
    growth: Growth,
    seed: list[int],
    progress: Progress | None = None,
    out_of_time: Callable[[], bool] = lambda: False,
    reopen: float = 1.0,
) -> None:
    """Expands the leaves until each meets the goal or nothing gets it nearer, those that hold most first.

    The tree is a whole plan at any time, so it may be stopped at any node.

    Args:
        root: the tree, modified in place.
        growth: how.
        seed: every node draws from a stream of its own, named after its path.
        progress: called with the number of nodes done and the number waiting.
        out_of_time: asked before each node; the tree stays as it is once it says so.
        reopen: mode ratio with which a leaf that the tree already has stays one, whatever new ones need.
    """
    confidence = growth.look_ahead.confidence
    leaves = [node for node in breadth_first(root) if not node.children]
    open_ones = [leaf for leaf in leaves if leaf.worth_growing(reopen)]
    waiting = [(-node.unlocated_mass, node.path, node) for node in open_ones]
    heapq.heapify(waiting)
    done = 0
    while waiting and not out_of_time():
        _, path, node = heapq.heappop(waiting)
        done += 1
        if node.mode.ratio < confidence:
            _expand(node, growth, np.random.default_rng([*seed, len(path), *path]))
            for child in node.children:
                heapq.heappush(waiting, (-child.unlocated_mass, child.path, child))
        if progress is not None:
            progress(done, len(waiting))


def learn(
    root: TreeNode,
    beliefs: dict[int, Array],
    metric: Metric,
    confidence: float,
    against: Collection[int] = (),
) -> float:
    """Adds to the leaves the poses that an evaluation found there.

    Args:
        root: the tree, modified in place.
        beliefs: poses (n, 3) by the leaf's number, breadth first.
        metric: of the goal.
        confidence: mode ratio that leaves must have.
        against: the leaves that the evaluation refutes.

    Returns:
        The share of all parts that end in leaves which no longer hold, and may be grown further.
    """
    short = 0.0
    leaves = [node for node in breadth_first(root) if not node.children]
    for number, node in enumerate(leaves):
        poses = beliefs.get(number)
        if poses is None or not len(poses):
            continue
        met = node.mode.ratio >= confidence
        node.refuted = number in against
        node.belief = np.concatenate([node.belief, without_friction(poses)])
        node.mode = metric.mode(node.belief)
        fails = (met and node.mode.ratio < confidence) or node.refuted
        if fails and node.worth_growing(confidence):
            short += node.share
    return short


def _expand(node: TreeNode, growth: Growth, rng: np.random.Generator) -> None:
    """Chooses the node's action and squeezes there; leaves it as it is where none gains anything."""
    may = node.depth < growth.max_depth and node.squeezes_without_gain < MOST_WITHOUT_GAIN
    choices = growth.look_ahead.choose(node.belief, rng, 1 + ALTERNATIVES, node.share) if may else []
    if choices:
        squeeze_at(node, choices[0].placement, growth, rng)
        node.alternatives = [choice.placement for choice in choices[1:]]
    else:
        node.exhausted = node.mode.ratio


def squeeze_at(node: TreeNode, placement: Array, growth: Growth, rng: np.random.Generator) -> None:
    """Squeezes a node's belief, and adds a child for each cluster of outcomes.

    Args:
        node: a leaf of the tree, modified in place.
        placement: (3,) the hand frame in the world.
        growth: how the tree is grown.
        rng: source of randomness.
    """
    node.placement = placement
    node.opening_mm, node.clearance_mm = growth.handling.opening(node.belief, placement)
    belief = replenish(growth.handling.clear(node.belief, placement), LEAST_PARTICLES)
    outcomes = growth.reference.squeeze([(belief, placement)], rng)[0]
    node.clusters, node.unstable = outcomes.clusters, outcomes.unstable
    node.cost = growth.look_ahead.costs.of(outcomes)
    node.release = growth.handling.release(outcomes)
    beliefs = growth.handling.released(placement, node.release, outcomes)
    for k, (share, child) in enumerate(zip(outcomes.probability, beliefs, strict=True)):
        mode = growth.look_ahead.metric.mode(child)
        node.children.append(TreeNode(child, node.share * float(share), mode, (*node.path, k)))
    squeezes_without_gain = 0 if _gain(node) > LEAST_PROGRESS else node.squeezes_without_gain + 1
    for grown in node.children:
        grown.squeezes_without_gain = squeezes_without_gain


def _gain(node: TreeNode) -> float:
    """What a node's squeeze gained in mode ratio, beyond selection bias."""
    after = sum(child.share * child.mode.ratio for child in node.children) / node.share
    ratio = node.mode.ratio
    return after - ratio - selection_bias(ratio, len(node.belief), len(node.children))
