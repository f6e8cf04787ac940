"""The tree of a plan: beliefs, the actions tried at each of them, and their values.

An OR node (`Node`) is a belief, that is, a set of equally likely particles. An AND node (`Action`) is a
squeeze at one grasp pose together with a partition of the encoder's readings; each interval leads to a child.
Values are expected costs in typical squeezes; a part that is not located costs `failure` of them:

    value(node)   = min over its actions of value(action); the leaf heuristic if it has none
    value(action) = cost + failure P(crash) + (1 - P(crash)) sum over children of P(child) value(child)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from planner.arrays import Array
from planner.belief.costs import Hand
from planner.belief.metric import Mode
from planner.belief.observation import Partition
from planner.belief.particles import Belief
from planner.belief.partition import Rule
from planner.belief.transition import Push, Squeezed


@dataclass(frozen=True, slots=True, eq=False)
class Squeeze:
    """What the hand does at a node of the plan: pushes, if any, a squeeze, and the release.

    Attributes:
        placement: (3,) grasp pose: the hand frame in the world [mm, mm, rad].
        opening_mm: opening of the jaws on the way down.
        clearance_mm: least distance between the believed part and the fingers at this opening.
        clusters: the partition of the readings.
        release: (2,) hand centre in the world where the jaws open after a drag; None: the hand does not drag.
        pushes: pushes before the squeeze.
        cost: cost of the pushes and the squeeze, in typical squeezes.
        crashes: share of the parts that an open finger would come down on.
    """

    placement: Array
    opening_mm: float
    clearance_mm: float
    clusters: Partition
    release: Array | None = None
    pushes: tuple[Push, ...] = ()
    cost: float = 1.0
    crashes: float = 0.0


class Origin(NamedTuple):
    """What an action's partition of the readings was computed from."""

    before: Belief  # particles when the jaws begin to close
    after: Squeezed  # outcome of the squeeze for these particles
    rule: Rule  # prices that the partition minimises


@dataclass(slots=True, eq=False)
class Action:
    """A squeeze of a node's belief and a child for each interval of readings.

    Attributes:
        squeeze: what the hand does.
        children: the children in the order of the partition.
        value: expected cost from the node on.
        origin: input of the partition; None in plans of the paper's method.
    """

    squeeze: Squeeze
    children: list[Node]
    value: float = 0.0
    origin: Origin | None = None


@dataclass(slots=True, eq=False)
class Node:
    """A belief and the actions tried there.

    Attributes:
        belief: where the part may lie.
        share: probability of reaching the node.
        mode: the pose that explains most of the belief.
        depth: number of squeezes before this node.
        stalled: consecutive squeezes before this node that gained nothing.
        actions: the best first; None if not expanded yet, empty if no action gains anything.
        value: expected cost from here on.
        hand: where the hand stands; None before the first squeeze.
        home: (3,) grasp pose of the first squeeze, where the hand goes for the next part; None at the root.
        fresh: number of particles that trials of the plan have added; they come first in the belief.
        refuted: whether these trials show that a leaf at the mode misses the goal.
        parent: the node above; None at the root.
        previous: the corresponding node of the previous pass.
    """

    belief: Belief
    share: float
    mode: Mode
    depth: int = 0
    stalled: int = 0
    actions: list[Action] | None = None
    value: float = 0.0
    hand: Hand | None = None
    home: Array | None = None
    fresh: int = 0
    refuted: bool = False
    parent: Node | None = None
    previous: Node | None = None

    @property
    def best(self) -> Action | None:
        """The cheapest action; None at a leaf."""
        return self.actions[0] if self.actions else None

    @property
    def squeeze(self) -> Squeeze | None:
        """The plan's squeeze at this node; None at a leaf."""
        return self.best.squeeze if self.best else None

    @property
    def children(self) -> Sequence[Node]:
        """The children of the best action."""
        return self.best.children if self.best else ()


def dilute(node: Node, factor: float) -> None:
    """Scales the probability of a node and of all below it."""
    node.share *= factor
    for action in node.actions or ():
        for child in action.children:
            dilute(child, factor)


def breadth_first(root: Node) -> list[Node]:
    """All nodes of the plan, the root first: the order in which a table numbers them."""
    order, waiting = list[Node](), deque([root])
    while waiting:
        node = waiting.popleft()
        order.append(node)
        waiting.extend(node.children)
    return order


def leaves(root: Node) -> list[Node]:
    """The leaves of the plan in the order of its table."""
    return [node for node in breadth_first(root) if not node.children]


def pruned(root: Node, kept: Sequence[Sequence[int]]) -> Node:
    """A copy of the plan without alternative actions, reduced to the children in `kept`.

    For each inner node in the order of the table, `kept` has the numbers of the children that remain.
    """
    inner = [node for node in breadth_first(root) if node.children]
    chosen = {id(node): numbers for node, numbers in zip(inner, kept, strict=True)}

    def copied(node: Node) -> Node:
        result = replace(node, parent=None, previous=None)
        if node.best is not None:
            numbers, clusters = chosen[id(node)], node.best.squeeze.clusters
            squeeze = replace(node.best.squeeze, clusters=clusters.of_clusters(numbers))
            children = [copied(node.children[k]) for k in numbers]
            result.actions = [replace(node.best, squeeze=squeeze, children=children)]
        return result

    return copied(root)
