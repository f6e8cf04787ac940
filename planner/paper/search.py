"""ExpandTree: Algorithm 1 of the paper as printed, and its sensorless variant.

Unlike in the default method, the action of a node is the first action of the best open-loop sequence, the
printed singleton ratio measures progress, learned models move the belief, and a reading always leads to the
child whose expected width is nearest.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, IntArray, take
from planner.belief.metric import Mode
from planner.belief.observation import Encoder, Partition
from planner.belief.particles import Belief
from planner.frames import to_hand, to_world, wrap
from planner.learned.kcde import Kcde
from planner.learned.rollouts import COLLIDES, RollOuts
from planner.mechanics.simulator import Simulator
from planner.paper.open_loop import Motion, OpenLoop
from planner.paper.projection import Projection
from planner.paper.sensor import Collides, Widths, collision_detector, sensor_model
from planner.paper.subspaces import Subspaces, subspaces_of
from planner.search.tree import Action, Node, Squeeze
from planner.work.progress import Report, silent

Path: TypeAlias = tuple[int, ...]  # the branches taken on the way to a node
METHODS = ("paper", "sensorless")
"""Algorithm 1, and a whole open-loop sequence without branching."""
TOLERANCES = (2.5, 2.5, math.radians(5.0))
"""Half-widths of the box about the average pose (paper, VII): x, y [mm] and theta [rad]."""
SINGLETON_SHARE = 0.95  # r_s, the singleton ratio above which a node is a leaf
MOST_SEQUENCES = 500  # most open-loop sequences of the greatest length that a search judges
DEEPEST = 3  # greatest depth of the search for open-loop sequences
SENSORLESS_DEPTH = 5  # the same depth for the sensorless method
SENSORLESS_BUDGET = 400
"""Most beliefs to expand: four actions and five squeezes need 341, and the paper saw no gain beyond four."""


def singleton(poses: Array, order: int) -> Mode:
    """SingletonRatio(X, eps) as printed (VI.1): average pose of particles (m, 3), and share near this pose.

    The average is over x, y, cos(n theta) and sin(n theta); near means within `TOLERANCES`. The paper prints
    n = 2; here n is the part's rotational order. For a belief of two modes the average lies between the
    modes, and the ratio is near 0. So the default method uses the mode ratio of `planner.belief.metric`.
    """
    turned = order * poses[:, 2]
    theta = math.atan2(np.sin(turned).mean(), np.cos(turned).mean()) / order
    pose = np.array([poses[:, 0].mean(), poses[:, 1].mean(), theta])
    off = np.abs(poses - pose)
    off[:, 2] = np.abs(wrap(poses[:, 2] - theta, order))
    return Mode(pose, float((off <= TOLERANCES).all(axis=1).mean()))


class Models(NamedTuple):
    """Models learned from the roll-outs before planning (paper VI, pre-planning steps 1 and 2)."""

    motion: Motion
    widths: Widths
    collides: Collides
    subspaces: Subspaces
    projection: Projection


def learn(
    rolled: RollOuts, simulator: Simulator, encoder: Encoder, rho_mm: float, order: int
) -> Models:
    """Fits the motion model, sensor model, collision detector, subspaces and projection to roll-outs.

    The roll-outs include those in which a finger collides with the part. One radian counts as `rho_mm`
    millimetres; `order` is the rotational order of the part.

    Raises:
        ValueError: no roll-out touches the part, or too few are free of collision.
    """
    stands = rolled.status == COLLIDES
    free = take(rolled, ~stands)
    kcde = Kcde.fit(free, simulator.outline, simulator.jaws, rho_mm, order)
    subspaces = subspaces_of(free.width_mm, encoder)
    return Models(
        motion=lambda poses, rng: kcde.sample(poses, rng, simulator.workers).poses,
        widths=sensor_model(free.final, free.width_mm, order),
        collides=collision_detector(rolled.initial, stands, order),
        subspaces=subspaces,
        projection=Projection.fit(free.final, subspaces.label(free.width_mm), rho_mm, order),
    )


@dataclass(frozen=True, slots=True, eq=False)
class PaperPlanner:
    """Grows trees by the paper's algorithm."""

    placements: Array  # (k, 3) the actions: the hand frame in the world
    models: Models  # moves and observes beliefs
    encoder: Encoder  # turns expected widths into readings
    # clearance [mm] of poses (n, 3) of the part from open fingers at a placement (3,); < 0 in collision
    clearance: Callable[[Array, Array], float]
    method: str  # one of `METHODS`
    depth: int  # d, the length of the longest open-loop sequence
    max_depth: int  # longest path of the tree, which the paper does not bound [squeezes]
    order: int  # the part's rotational order; the paper's parts have 2

    def plan(self, belief: Array, seed: list[int], report: Report = silent) -> Node:
        """ExpandTree(C, eps, r_s, d) from particles (n, 3) in the world, breadth first instead of recursive.

        A leaf whose ratio is not above r_s could not be expanded: either the leaf lies at the maximum depth,
        or each action collides or lowers the ratio too much. The random stream of a node is seeded by `seed`,
        the node's depth, and the branches that lead to the node.

        Returns:
            The root of the tree.
        """
        root = Node(Belief.of(belief), 1.0, singleton(belief, self.order))
        waiting, done = deque[tuple[Node, Path]]([(root, ())]), 0
        while waiting:
            node, path = waiting.popleft()
            done += 1
            if node.mode.ratio <= SINGLETON_SHARE and node.depth < self.max_depth:
                rng = np.random.default_rng([*seed, node.depth, *path])
                ends = self._expanded(node, rng)
                waiting.extend((end, (*path, k)) for k, end in enumerate(ends))
            report("search", done, done + len(waiting))
        return root

    def _expanded(self, node: Node, rng: Generator) -> list[Node]:
        """Gives a node an action, or a chain of actions if sensorless; returns the nodes to expand next."""
        actions = self._search(self.max_depth - node.depth).search(node.belief.poses, rng).actions
        if self.method == "sensorless":
            for action in actions:
                (node,) = self._squeezed(node, self.placements[action], rng, branching=False)
            return []
        if not actions:
            return []
        return self._squeezed(node, self.placements[actions[0]], rng, branching=True)

    def _search(self, longest: int) -> OpenLoop:
        """The search for sequences of at most `longest` actions."""
        sensorless = self.method == "sensorless"
        return OpenLoop(
            placements=self.placements,
            motion=self.models.motion,
            collides=self.models.collides,
            ratio=lambda poses: singleton(poses, self.order).ratio,
            depth=min(SENSORLESS_DEPTH if sensorless else self.depth, longest),
            enough=SINGLETON_SHARE if sensorless else math.inf,
            budget=SENSORLESS_BUDGET if sensorless else math.inf,
        )

    def _squeezed(
        self, node: Node, placement: Array, rng: Generator, branching: bool
    ) -> list[Node]:
        """Gives a node its action, the squeeze at `placement` (3,), and returns the children.

        With `branching` there is a child for each observation, else one child for all widths.
        """
        hand = self.models.motion(to_hand(node.belief.poses, placement), rng)
        width = self.models.widths(hand)
        subspace = np.zeros(len(width), np.int64)
        if branching:  # the end of Algorithm 2, then the loop of Algorithm 1
            subspace = self.models.subspaces.label(width)
            hand = self.models.projection.project(hand, subspace)
        clusters, label = nearest_observation(self.encoder, width, subspace)
        poses = to_world(hand, placement)
        # Particles that the learned detector let through would make the clearance negative.
        clearance = max(self.clearance(node.belief.poses, placement), 0.0)
        children = list[Node]()
        for k in range(len(clusters.mean)):
            belief = poses[label == k]
            share, mode = node.share * len(belief) / len(node.belief), singleton(belief, self.order)
            children.append(Node(Belief.of(belief), share, mode, node.depth + 1))
        squeeze = Squeeze(placement, self.encoder.opening_mm, clearance, clusters)
        node.actions = [Action(squeeze, children)]
        return children


def nearest_observation(
    encoder: Encoder, width_mm: Array, subspace: IntArray
) -> tuple[Partition, IntArray]:
    """Assigns each reading to a child by the paper's rule: to the child of the nearest expected reading.

    Each particle (n,) has an expected width [mm] and the number of a subspace. Each subspace becomes a child;
    subspaces whose mean widths give the same reading become one child, since no reading distinguishes them.

    Returns:
        The partition of all readings into one interval for each child, and the child (n,) of each particle.
    """
    counts = np.clip(encoder.steps - width_mm / encoder.mm_per_step, 0, encoder.steps)
    member = np.unique(subspace, return_inverse=True)[1]
    size = np.bincount(member)
    expected = np.rint(np.bincount(member, counts) / size).astype(np.int64)
    # Rising widths are falling readings.
    result, child = np.unique(-expected[member], return_inverse=True)
    size = np.bincount(child)
    mean = np.bincount(child, counts) / size
    label = np.argmin(np.abs(np.arange(encoder.steps + 1)[:, None] - mean[None]), axis=1)
    cells = [np.flatnonzero(label == k) for k in range(len(result))]
    low, high = np.array([cell[0] for cell in cells]), np.array([cell[-1] for cell in cells])
    return Partition(mean, low, high, size), child


def search_depth(actions: int) -> int:
    """Depth d of the search, which the paper does not state: 3, or less if there are too many sequences."""
    return next((d for d in range(DEEPEST, 1, -1) if actions**d <= MOST_SEQUENCES), 1)
