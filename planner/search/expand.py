"""Growing the tree: Algorithm 1 of the paper, with the action chosen by closed-loop look-ahead."""

from __future__ import annotations

import heapq
import math
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array, BoolArray
from planner.belief.metric import Mode
from planner.belief.observation import Partition
from planner.belief.particles import Belief, replenish
from planner.belief.recut import recut
from planner.belief.transition import MotionModel, Outcomes, Push, Squeezed
from planner.search.actions import Action
from planner.search.closed_loop import LookAhead
from planner.search.handling import Handling
from planner.search.params import Objective
from planner.search.pushes import Pusher
from planner.search.ranking import Choice, selection_bias
from planner.work.scheduler import pool_of

Progress = Callable[[int, int], None]
Chosen: TypeAlias = tuple[list[Choice], np.random.Generator]  # a node's placements, and its stream after it


def untold(_done: int, _waiting: int) -> None:
    """Progress that nobody hears of."""


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
        pushes: made before it.
    """

    placement: Array
    opening_mm: float
    clearance_mm: float
    clusters: Partition
    unstable: float = 0.0
    release: Array | None = None
    cost: float = 0.0
    crashes: float = 0.0
    pushes: tuple[Push, ...] = ()


class Found(NamedTuple):
    """The parts of an evaluation that came to a leaf."""

    belief: Belief
    new: BoolArray  # (n,) those of which the leaf has not learned before


@dataclass(slots=True, eq=False)
class TreeNode:
    """A node of the plan: a belief, and either a squeeze with its outcomes or a predicted pose.

    Attributes:
        belief: where the part may lie.
        share: probability of getting here.
        mode: the pose that explains most of the belief.
        path: names of the branches taken on the way; no two nodes of a tree have the same.
        squeezes_without_gain: how many just before this node got the belief no nearer the goal.
        squeeze: what is done here; None at a leaf.
        children: one node for each cluster of its outcomes.
        named: how many names of children were given away.
        alternatives: further actions that looked promising, the best first.
        refuted: fresh trials spoke against it, as a leaf.
        doubted: how many of the last particles come from worlds that are off: they are nobody's share.
        exhausted: mode ratio at which no squeeze gained anything or none was left; above 1 where none was
            looked for.
        searched: size of the belief then.
    """

    belief: Belief
    share: float
    mode: Mode
    path: tuple[int, ...] = ()
    squeezes_without_gain: int = 0
    squeeze: PlannedSqueeze | None = None
    children: list[TreeNode] = field(default_factory=list)
    named: int = 0
    alternatives: list[Action] = field(default_factory=list)
    refuted: bool = False
    doubted: int = 0
    exhausted: float = math.inf
    searched: int = 0

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
        pusher: proposes pushes before squeezes; None: there are none.
    """

    look_ahead: LookAhead
    reference: MotionModel
    handling: Handling
    max_depth: int
    pusher: Pusher | None = None

    @property
    def objective(self) -> Objective:
        """What the plan is to reach."""
        return self.look_ahead.objective

    def worth_growing(self, leaf: TreeNode, reopen: float) -> bool:
        """Whether a leaf holds less than `reopen`, or is refuted, and one more squeeze may help.

        None may where the path is as long as allowed or the last squeezes were in vain, nor where none was
        found and the belief is about the same since.
        """
        ratio, params = leaf.mode.ratio, self.objective.params
        may = leaf.depth < self.max_depth and leaf.squeezes_without_gain < params.most_without_gain
        changed = ratio < leaf.exhausted - params.least_loss
        changed |= len(leaf.belief) >= params.searched_again * leaf.searched
        return (ratio < reopen or leaf.refuted) and may and changed


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
    progress: Progress = untold,
    out_of_time: Callable[[], bool] = lambda: False,
    reopen: float = 1.0,
    least: float = 0.0,
) -> None:
    """Expands the leaves until each meets the goal or nothing gets it nearer, those that hold most first.

    The tree is a whole plan at any time, so it may be stopped at any node. A node's placements depend on
    nothing but itself, so they are chosen for as many nodes at once as there are workers; by one, in the
    caller's thread.

    Args:
        root: the tree, modified in place.
        growth: how.
        seed: every node draws from a stream of its own, named after its path.
        progress: called with the number of nodes done and the number waiting.
        out_of_time: asked before each node; the tree stays as it is once it says so.
        reopen: mode ratio with which a leaf that the tree already has stays one, if new ones need more.
        least: share of all parts: leaves that locate all but less are left as they are.
    """
    inner = [node for node in breadth_first(root) if node.children]
    pairs: list[tuple[TreeNode, TreeNode | None]] = [(root, None)]
    if inner:
        pairs = [(child, node) for node in inner for child in node.children]
    confidence = growth.objective.confidence
    waiting = [
        (-leaf.unlocated_mass, leaf.path, leaf, parent)
        for leaf, parent in pairs
        if not leaf.children
        and leaf.unlocated_mass >= least
        and growth.worth_growing(leaf, min(reopen, confidence))
    ]
    heapq.heapify(waiting)
    done, ahead = 0, dict[tuple[int, ...], Future[Chosen]]()
    workers = growth.look_ahead.ranking.mixture.workers
    with pool_of(workers) as pool:
        while waiting and not out_of_time():
            _, path, node, parent = heapq.heappop(waiting)  # paths differ: no tie goes further
            for _, its_path, leaf, _ in heapq.nsmallest(workers - 1, waiting):
                if its_path not in ahead:
                    ahead[its_path] = pool.submit(_chosen, leaf, growth, seed)
            chosen = ahead.pop(path).result() if path in ahead else _chosen(node, growth, seed)
            done += 1
            for leaf, above in _expand(node, parent, growth, chosen):
                if leaf.unlocated_mass >= least and growth.worth_growing(leaf, confidence):
                    heapq.heappush(waiting, (-leaf.unlocated_mass, leaf.path, leaf, above))
            progress(done, len(waiting))
        pool.shutdown(cancel_futures=True)


def learn(
    root: TreeNode,
    found: dict[int, Found],
    growth: Growth,
    confidence: float,
    refutes: Callable[[BoolArray], bool],
) -> float:
    """Adds to the leaves the poses that an evaluation found there, and predicts from all of them.

    Args:
        root: the tree, modified in place.
        found: what lay there by the leaf's number, breadth first.
        growth: how it was grown.
        confidence: mode ratio that leaves must have.
        refutes: whether parts speak against a leaf, by which of them (n,) it predicts.

    Returns:
        The share of all parts that end in leaves which no longer hold, and may be grown further.
    """
    short = 0.0
    leaves = [node for node in breadth_first(root) if not node.children]
    for number, node in enumerate(leaves):
        here = found.get(number)
        if here is None or not len(here.belief):
            continue
        met = node.mode.ratio >= confidence
        if here.new.any():
            node.belief = Belief.joined([here.belief[here.new], node.belief])  # what is doubted stays last
            node.mode = growth.objective.metric.mode(node.belief.states)
        node.refuted = refutes(growth.objective.metric.explained(here.belief.states, node.mode))
        fails = (met and node.mode.ratio < confidence) or node.refuted
        if fails and growth.worth_growing(node, confidence):
            short += node.share
    return short


def _chosen(node: TreeNode, growth: Growth, seed: list[int]) -> Chosen:
    """Where to squeeze a node's belief: nowhere if nothing gains anything."""
    rng = np.random.default_rng([*seed, node.depth, *node.path])
    most, vain = 1 + growth.objective.params.alternatives, node.squeezes_without_gain
    choices = growth.look_ahead.choose(node.belief, rng, most, node.share, vain)
    if growth.pusher is not None:
        choices = growth.pusher.choose(node.belief, choices, growth.look_ahead, rng, most, node.share)
    return choices, rng


def _expand(
    node: TreeNode, parent: TreeNode | None, growth: Growth, chosen: Chosen
) -> list[tuple[TreeNode, TreeNode]]:
    """Squeezes where the node's best choice says; the new leaves, each with its parent."""
    choices, rng = chosen
    if not choices:
        node.exhausted, node.searched = node.mode.ratio, len(node.belief)
        return []
    node.alternatives = [choice.action for choice in choices[1:]]
    return squeeze_at(node, parent, choices[0].action, growth, rng)


class _Made(NamedTuple):
    """What an action makes of a node's belief."""

    pushed: Belief  # as it lies after the pushes
    begun: Belief  # what of it the squeeze begins with
    squeezed: Squeezed
    arrives: float  # share without a finger on the part


def squeeze_at(
    node: TreeNode, parent: TreeNode | None, action: Action, growth: Growth, rng: np.random.Generator
) -> list[tuple[TreeNode, TreeNode]]:
    """Pushes and squeezes a node's belief, and adds a child for each cluster of outcomes.

    Where the squeeze shows that the readings which led here had better been told apart, the node becomes
    several children of its parent; the squeeze is the heaviest one's.

    Args:
        node: a leaf of the tree, modified in place.
        parent: its parent, likewise; None for the root.
        action: what is done.
        growth: how the tree is grown.
        rng: source of randomness.

    Returns:
        New leaves, each with its parent.
    """
    made = _made(node, action, growth, rng)
    others = []
    if parent is not None:
        others = _separated(node, parent, made, growth)
        if others:
            made = _made(node, action, growth, rng)
    _attach(node, action, made, growth)
    leaves = [(child, node) for child in node.children]
    return leaves + [(other, parent) for other in others if parent is not None]


def _made(node: TreeNode, action: Action, growth: Growth, rng: np.random.Generator) -> _Made:
    lying = node.belief
    for push in action.pushes:
        assert growth.pusher is not None
        lying = growth.pusher.model.push(lying, push, rng)
    clear = growth.handling.clear(lying, action.placement)
    begun = replenish(clear, growth.objective.params.least_particles)
    squeezed = growth.reference.squeeze([(begun, action.placement)], rng)[0]
    return _Made(lying, begun, squeezed, len(clear) / len(lying))


def _separated(node: TreeNode, parent: TreeNode, made: _Made, growth: Growth) -> list[TreeNode]:
    """Cuts a node in several where that leaves fewer squeezes: it becomes the heaviest piece."""
    belief, metric, share = node.belief, growth.objective.metric, node.share
    cuts = recut(made.begun, made.squeezed.belief, growth.objective.rule)
    piece = np.searchsorted(cuts, belief.reading, side="right")
    numbers, size = np.unique(piece, return_counts=True)
    if len(numbers) < 2:
        return []
    stated = len(piece) - node.doubted
    pieces = []
    for k in numbers[::-1]:  # the widest first: counts fall as widths rise
        part = belief[piece == k]
        other = node
        if k != numbers[np.argmax(size)]:
            path = (*parent.path, parent.named)
            parent.named += 1
            other = TreeNode(part, 0.0, node.mode, path, node.squeezes_without_gain)
        other.belief, other.share = part, share * float(np.mean(piece[:stated] == k))
        other.doubted = int(np.sum(piece[stated:] == k))
        other.mode = metric.mode(part.states)
        pieces.append(other)
    replace_child(parent, node, pieces)
    return [other for other in pieces if other is not node]


def replace_child(parent: TreeNode, child: TreeNode, pieces: list[TreeNode]) -> None:
    """Puts nodes that stand for disjoint readings in the place of one child.

    Beliefs may have been added to since: how many readings an interval holds is told by the shares.
    """
    assert parent.squeeze is not None
    at = next(i for i, other in enumerate(parent.children) if other is child)
    parent.children[at : at + 1] = pieces
    clusters = Partition.of([other.belief.reading for other in parent.children])
    share = np.array([other.share for other in parent.children])
    size = np.rint(parent.squeeze.clusters.size.sum() * share / share.sum()).astype(np.int64)
    parent.squeeze = parent.squeeze._replace(clusters=clusters._replace(size=size))


def _attach(node: TreeNode, action: Action, made: _Made, growth: Growth) -> None:
    """Adds an action's outcomes to a node."""
    metric, params = growth.objective.metric, growth.objective.params
    costs, arrives = growth.objective.costs, made.arrives
    outcomes = Outcomes.of(made.squeezed, growth.objective.rule)
    ratio = metric.shares([child.states for child in outcomes.beliefs], metric.modes).sum(axis=1)
    # No leaf takes a width far from what any part read: a stranger's, or of a part out of tolerance.
    most = 2 * growth.objective.rule.resolution.margin
    outcomes = outcomes.without_gaps(ratio >= growth.objective.confidence, most)
    release = growth.handling.release(outcomes)
    placement, pushes = action
    cost = costs.of(outcomes.unstable, outcomes.width_mm) + sum(map(costs.of_push, pushes))
    node.squeeze = PlannedSqueeze(
        placement, *growth.handling.opening(made.pushed, placement), outcomes.clusters, outcomes.unstable,
        release, cost, 1.0 - arrives, pushes,
    )  # fmt: skip
    beliefs = growth.handling.released(placement, release, outcomes)
    modes = [metric.mode(child.states) for child in beliefs]
    shares = arrives * outcomes.probability
    after = sum(share * mode.ratio for share, mode in zip(shares, modes, strict=True))
    bias = selection_bias(node.mode.ratio, len(node.belief), len(beliefs), params)
    gains = after - node.mode.ratio - bias > params.least_gain
    squeezes_without_gain = 0 if gains else node.squeezes_without_gain + 1
    node.children = [
        TreeNode(child, node.share * float(share), mode, (*node.path, k), squeezes_without_gain)
        for k, (share, child, mode) in enumerate(zip(shares, beliefs, modes, strict=True))
    ]
    node.named = len(node.children)
