"""ExpandTree: Algorithm 1 of the paper as printed, and its sensorless variant.

Unlike in the default method the action is the first of the best open-loop sequence, progress is the printed
singleton ratio, beliefs are moved by learned models, and a reading always leads to the child whose expected
width is nearest.
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
SINGLETON_SHARE = 0.95  # r_s
MOST_SEQUENCES = 500
DEEPEST = 3
SENSORLESS_DEPTH = 5
SENSORLESS_BUDGET = 400
"""Beliefs expanded; four actions and five squeezes need 341, and the paper saw no gain beyond four."""


def singleton(poses: Array, order: int) -> Mode:
    """SingletonRatio(X, eps) as printed (VI.1): the average of particles (m, 3), and the share near it.

    The average is over x, y, cos(n theta) and sin(n theta), n the order; near means within `TOLERANCES`.
    The paper prints n = 2. The average of two modes lies between them, so the ratio is always near 0; the
    default method uses the mode ratio of `planner.belief.metric`.
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

    The roll-outs include those that collide with the part. One radian counts as `rho_mm`; `order` is the
    part's rotational order.

    Raises:
        ValueError: no roll-out touches the part, or there are too few.
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
    # of open fingers at (3,) from poses (n, 3) [mm], < 0: collision
    clearance: Callable[[Array, Array], float]
    method: str  # one of `METHODS`
    depth: int  # d, the longest open-loop sequence
    max_depth: int  # longest path of the tree, which the paper does not bound [squeezes]
    order: int  # the part's rotational order; the paper's parts have 2

    def plan(self, belief: Array, seed: list[int], report: Report = silent) -> Node:
        """ExpandTree(C, eps, r_s, d) from particles (n, 3) in the world, breadth first instead of recursive.

        A leaf whose ratio is not above r_s could not be expanded: either no action was free of collision and
        kept the ratio, or the leaf lies at the maximum depth. The random stream of a node is seeded by
        `seed`, the node's depth, and the branches that lead to the node.
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
        """Gives a node its action, with a child for each observation, or one for all widths."""
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
    """Assigns all readings and particles to children by the paper's rule: the nearest expected reading.

    Particles (n,) have an expected width [mm] and a subspace; subspaces whose mean widths fall on one reading
    become one child, since no reading distinguishes them. Returns the children's cells, which share out all
    readings, and each particle's child (n,).
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
    """Depth d of the search, which the paper does not state: 3, or less where sequences are too many."""
    return next((d for d in range(DEEPEST, 1, -1) if actions**d <= MOST_SEQUENCES), 1)
