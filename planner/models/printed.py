"""The learned models as the paper prints them (V), all from one set of roll-outs.

Motion is the kernel estimate with h1 = h2 = 0.5 mm over 400 neighbours, the sensor a regression tree, the
collision detector a classification tree, and subspaces are clusters of widths with the final poses seen in
them.
`planner.models.learned` has the models that the default method uses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from scipy.spatial import KDTree
from sklearn.cluster import KMeans
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from planner.arrays import Array, BoolArray, IntArray
from planner.frames import wrap
from planner.mechanics.simulator import Simulator
from planner.models.kcde import Kcde
from planner.models.rollouts import COLLIDES, RollOuts

EMPTY_MM = 1.0
"""Jaws that close to less than this hold nothing."""
EXPLAINED = 0.97
"""Share of the variance of held widths that lies between clusters: 0.97 gives the rectangle its k = 4."""
MOST_CLUSTERS = 8
LEAST_LEAF = 3
"""Roll-outs that a leaf of the sensor's tree averages at least."""


class Printed(NamedTuple):
    """What the paper learns before planning."""

    motion: KernelMotion
    sensor: TreeSensor
    collision: TreeCollision
    subspaces: WidthSubspaces


def learn(rolled: RollOuts, simulator: Simulator, rho_mm: float, order: int) -> Printed:
    """Fits all four models.

    Args:
        rolled: roll-outs, of which some touch the part and some collide with it.
        simulator: what they were rolled out with.
        rho_mm: what one radian weighs.
        order: rotational order of the part.

    Raises:
        ValueError: no roll-out touches the part.
    """
    stands = rolled.status == COLLIDES
    free = RollOuts(*(column[~stands] for column in rolled))
    kcde = Kcde.fit(free, simulator.outline, simulator.jaws, rho_mm, order, paper=True)
    return Printed(
        KernelMotion(kcde, simulator.workers),
        TreeSensor.fit(free, order),
        TreeCollision.fit(rolled.initial, stands, order),
        WidthSubspaces.fit(free, rho_mm, order),
    )


@dataclass(frozen=True, slots=True, eq=False)
class KernelMotion:
    """ForwardMotionModel-KCDE."""

    kcde: Kcde
    workers: int

    def move(self, poses: Array, rng: np.random.Generator) -> Array:
        """Draws final poses for initial ones, both (n, 3) in the hand frame."""
        return self.kcde.sample(poses, rng, self.workers).poses


@dataclass(frozen=True, slots=True, eq=False)
class TreeSensor:
    """SensorModel-RegressionTree."""

    tree: DecisionTreeRegressor
    order: int

    @classmethod
    def fit(cls, rolled: RollOuts, order: int) -> Self:
        """Learns the width that belongs to a final pose."""
        tree = DecisionTreeRegressor(min_samples_leaf=LEAST_LEAF, random_state=0)
        return cls(tree.fit(_features(rolled.final, order), rolled.width_mm), order)

    def predict(self, poses: Array) -> Array:
        """Expected widths (n,) of final poses (n, 3) in the hand frame [mm]."""
        return np.asarray(self.tree.predict(_features(poses, self.order)))


@dataclass(frozen=True, slots=True, eq=False)
class TreeCollision:
    """CollisionFree-DecisionTree."""

    tree: DecisionTreeClassifier
    order: int

    @classmethod
    def fit(cls, initial: Array, stands: BoolArray, order: int) -> Self:
        """Learns from initial poses (n, 3) where an open finger stands on the part (n,)."""
        tree = DecisionTreeClassifier(random_state=0)
        return cls(tree.fit(_features(initial, order), stands), order)

    def collides(self, poses: Array) -> BoolArray:
        """Where an open finger would stand on the part; poses are (n, 3) in the hand frame."""
        return np.asarray(self.tree.predict(_features(poses, self.order)), dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class WidthSubspaces:
    """Clusters of widths, and the final poses seen in each (paper V.A, V.C).

    Cluster 0 is free space: the jaws closed on nothing. It has all three dimensions, so nothing needs to be
    projected onto it.

    Attributes:
        edges_mm: (k - 1,) widths between neighbouring clusters.
        poses: for each cluster the final poses (n_k, 3) seen in it, in the hand frame.
        trees: the same as points that are near each other where the normalised poses are.
        rho_mm: what one radian weighs.
        order: rotational order of the part.
    """

    edges_mm: Array
    poses: list[Array]
    trees: list[KDTree]
    rho_mm: float
    order: int

    @classmethod
    def fit(cls, rolled: RollOuts, rho_mm: float, order: int) -> Self:
        """Clusters the widths and keeps the poses."""
        edges = _edges(rolled.width_mm)
        label = np.searchsorted(edges, rolled.width_mm)
        poses = [rolled.final[label == k] for k in range(len(edges) + 1)]
        trees = [KDTree(_points(part, rho_mm, order)) for part in poses]
        return cls(edges, poses, trees, rho_mm, order)

    def label(self, widths_mm: Array) -> IntArray:
        """Cluster of each width: (n,) to (n,)."""
        return np.searchsorted(self.edges_mm, widths_mm)

    def project(self, poses: Array, label: IntArray) -> Array:
        """BeliefUpdateProjection: the nearest pose that was seen in its cluster, for each pose.

        Args:
            poses: (n, 3) in the hand frame.
            label: (n,) clusters.

        Returns:
            (n, 3), each turned by the symmetry to where it is nearest.
        """
        projected = poses.copy()
        for k in range(1, len(self.poses)):
            members = np.flatnonzero(label == k)
            if not (len(members) and len(self.poses[k])):
                continue
            nearest = self.trees[k].query(_points(poses[members], self.rho_mm, self.order))[1]
            projected[members] = self.poses[k][nearest]
            turn = wrap(projected[members, 2] - poses[members, 2], self.order)
            projected[members, 2] = poses[members, 2] + turn
        return projected


def _edges(width_mm: Array) -> Array:
    """Widths between the clusters of k-means, for the least k that explains enough; and free space apart."""
    held = np.sort(width_mm[width_mm >= EMPTY_MM])
    if not len(held):
        return np.array([EMPTY_MM])
    total = float(held.var())
    distinct = len(np.unique(held.round(2)))
    for k in range(1, min(MOST_CLUSTERS, distinct) + 1):
        start = np.quantile(held, (np.arange(k) + 0.5) / k)[:, None]
        means = KMeans(k, init=start, n_init=1).fit(held[:, None])
        if means.inertia_ <= (1.0 - EXPLAINED) * total * len(held):
            break
    centres = np.sort(means.cluster_centers_[:, 0])
    # Rounded, since k-means sums in no fixed order.
    between = np.round(0.5 * (centres[1:] + centres[:-1]), 3)
    return np.array([EMPTY_MM, *between])


def _features(poses: Array, order: int) -> Array:
    """What the trees split on: x, y, and the angle without a seam, (n, 4)."""
    turned = order * poses[:, 2]
    return np.column_stack([poses[:, :2], np.cos(turned), np.sin(turned)])


def _points(poses: Array, rho_mm: float, order: int) -> Array:
    """Points (n, 4) whose distances are those of the normalised poses where these are near [mm]."""
    return _features(poses, order) * np.array([1.0, 1.0, rho_mm / order, rho_mm / order])
