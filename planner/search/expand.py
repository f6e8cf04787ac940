"""Growing the tree: Algorithm 1 of the paper, with the action chosen by closed-loop look-ahead."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.metric import Mode
from planner.belief.observation import Partition
from planner.belief.particles import Belief, replenish
from planner.belief.transition import MotionModel
from planner.search.closed_loop import LookAhead
from planner.search.handling import Handling
from planner.search.params import Objective
from planner.search.ranking import selection_bias

Progress = Callable[[int, int], None]


class PlannedSqueeze(NamedTuple):
    """The action of an inner node.

    Attributes:
        placement: (3,) the hand frame to squeeze at, in the world [mm, mm, rad].
        opening_mm: opening of the jaws on the way down.
        clearance_mm: least distance between the open fingers there and the believed part.
        clusters: the partition of the outcomes.
        unstable: share of the outcomes that friction alone holds.
        release: (2,) where the hand opens after dragging a held part there; None: where it squeezed.
        cost: in squeezes.
        crashes: share of the parts here that an open finger would come down on.
    """

    placement: Array
    opening_mm: float
    clearance_mm: float
    clusters: Partition
    unstable: float = 0.0
    release: Array | None = None
    cost: float = 0.0
    crashes: float = 0.0


@dataclass(slots=True, eq=False)
class TreeNode:
    """A node of the plan: a belief, and either a squeeze with its outcomes or a predicted pose.

    Attributes:
        belief: where the part may lie.
        share: probability of getting here.
        mode: the pose that explains most of the belief.
        path: which branch was taken at each squeeze on the way.
        squeezes_without_gain: how many just before this node got the belief no nearer the goal.
        squeeze: what is done here; None at a leaf.
        children: one node for each cluster of its outcomes.
        alternatives: further placements (3,) that looked promising, the best first.
        refuted: fresh trials spoke against it, as a leaf.
        exhausted: mode ratio at which no squeeze gained anything or none was left; above 1 where none was
            looked for.
    """

    belief: Belief
    share: float
    mode: Mode
    path: tuple[int, ...] = ()
    squeezes_without_gain: int = 0
    squeeze: PlannedSqueeze | None = None
    children: list[TreeNode] = field(default_factory=list)
    alternatives: list[Array] = field(default_factory=list)
    refuted: bool = False
    exhausted: float = math.inf

    @property
    def depth(self) -> int:
        """Squeezes made so far."""
        return len(self.path)

    @property
    def unlocated_mass(self) -> float:
        """Share of all parts that end here, if it is a leaf, and are not known to be where it says."""
        return self.share * (1.0 - self.mode.ratio)

    @property
    def cost(self) -> float:
        """Squeezes of an average part here, 0 at a leaf: c times the share."""
        return self.share * self.squeeze.cost if self.squeeze else 0.0


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

    @property
    def objective(self) -> Objective:
        """What the plan is to reach."""
        return self.look_ahead.objective

    def worth_growing(self, leaf: TreeNode, reopen: float) -> bool:
        """Whether a leaf holds less than `reopen`, or is refuted, and less than when it was searched last."""
        ratio = leaf.mode.ratio
        return (ratio < reopen or leaf.refuted) and ratio < leaf.exhausted - self.objective.params.least_loss


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
    leaves = [node for node in breadth_first(root) if not node.children]
    open_ones = [leaf for leaf in leaves if growth.worth_growing(leaf, reopen)]
    waiting = [(-node.unlocated_mass, node.path, node) for node in open_ones]
    heapq.heapify(waiting)
    done = 0
    while waiting and not out_of_time():
        _, path, node = heapq.heappop(waiting)
        done += 1
        if node.mode.ratio < growth.objective.confidence:
            _expand(node, growth, np.random.default_rng([*seed, len(path), *path]))
            for child in node.children:
                heapq.heappush(waiting, (-child.unlocated_mass, child.path, child))
        if progress is not None:
            progress(done, len(waiting))


def learn(
    root: TreeNode,
    beliefs: dict[int, Array],
    growth: Growth,
    confidence: float,
    against: Collection[int] = (),
) -> float:
    """Adds to the leaves the poses that an evaluation found there.

    Args:
        root: the tree, modified in place.
        beliefs: poses (n, 3) by the leaf's number, breadth first.
        growth: how it was grown.
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
        node.belief = Belief.joined([node.belief, Belief.of(poses)])
        node.mode = growth.objective.metric.mode(node.belief.poses)
        fails = (met and node.mode.ratio < confidence) or node.refuted
        if fails and growth.worth_growing(node, confidence):
            short += node.share
    return short


def _expand(node: TreeNode, growth: Growth, rng: np.random.Generator) -> None:
    """Chooses the node's action and squeezes there; leaves it as it is where none gains anything."""
    params = growth.objective.params
    may = node.depth < growth.max_depth and node.squeezes_without_gain < params.most_without_gain
    choices = growth.look_ahead.choose(node.belief, rng, 1 + params.alternatives, node.share) if may else []
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
    metric, _, costs, params = growth.objective
    clear = growth.handling.clear(node.belief, placement)
    arrives = len(clear) / len(node.belief)
    belief = replenish(clear, params.least_particles)
    outcomes = growth.reference.squeeze([(belief, placement)], rng)[0]
    release = growth.handling.release(outcomes)
    node.squeeze = PlannedSqueeze(
        placement, *growth.handling.opening(node.belief, placement), outcomes.clusters, outcomes.unstable,
        release, costs.of(outcomes), 1.0 - arrives,
    )  # fmt: skip
    beliefs = growth.handling.released(placement, release, outcomes)
    modes = [metric.mode(child.poses) for child in beliefs]
    shares = arrives * outcomes.probability
    after = sum(share * mode.ratio for share, mode in zip(shares, modes, strict=True))
    bias = selection_bias(node.mode.ratio, len(node.belief), len(beliefs), params)
    gains = after - node.mode.ratio - bias > params.least_gain
    squeezes_without_gain = 0 if gains else node.squeezes_without_gain + 1
    node.children = [
        TreeNode(child, node.share * float(share), mode, (*node.path, k), squeezes_without_gain)
        for k, (share, child, mode) in enumerate(zip(shares, beliefs, modes, strict=True))
    ]
