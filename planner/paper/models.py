"""The learned models as the paper prints them (V), all from one set of roll-outs.

Motion is the kernel estimate with h1 = h2 = 0.5 mm over 400 neighbours, the sensor a regression tree, the
collision detector a classification tree of the same roll-outs, and subspaces are clusters of widths with the
final poses seen in them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from sklearn.tree import DecisionTreeClassifier

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.observation import Encoder
from planner.learned.kcde import Kcde
from planner.learned.rollouts import COLLIDES, RollOuts
from planner.mechanics.simulator import Simulator
from planner.paper.projection import Projection
from planner.paper.sensor import SensorModel, features
from planner.paper.subspaces import Subspaces, subspaces_of


@dataclass(frozen=True, slots=True, eq=False)
class KernelMotion:
    """ForwardMotionModel-KCDE."""

    kcde: Kcde
    workers: int

    def move(self, poses: Array, rng: np.random.Generator) -> Array:
        """Draws final poses for initial ones, both (n, 3) in the hand frame."""
        return self.kcde.sample(poses, rng, self.workers).poses


@dataclass(frozen=True, slots=True, eq=False)
class CollisionTree:
    """CollisionFree-DecisionTree: what roll-outs found. The planner itself goes by `mechanics.clearance`."""

    tree: DecisionTreeClassifier
    order: int

    @classmethod
    def fit(cls, initial: Array, stands: BoolArray, order: int) -> Self:
        """Learns from initial poses (n, 3) where an open finger stands on the part (n,)."""
        tree = DecisionTreeClassifier(random_state=0)
        return cls(tree.fit(features(initial, order), stands), order)

    def collides(self, poses: Array) -> BoolArray:
        """Where an open finger would stand on the part; poses are (n, 3) in the hand frame."""
        return np.asarray(self.tree.predict(features(poses, self.order)), dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class StoredSubspaces:
    """The subspaces of final poses that a width stands for, and the projection onto them."""

    subspaces: Subspaces
    projection: Projection

    def label(self, widths_mm: Array) -> IntArray:
        """Subspace of each width: (n,) to (n,)."""
        return self.subspaces.label(widths_mm)

    def project(self, poses: Array, label: IntArray) -> Array:
        """BeliefUpdateProjection: the nearest pose of its subspace for each pose, (n, 3) to (n, 3)."""
        return self.projection.project(poses, label)


@dataclass(frozen=True, slots=True, eq=False)
class Models:
    """What is learned from the roll-outs before planning (paper VI, pre-planning steps 1 and 2)."""

    motion: KernelMotion
    sensor: SensorModel
    collision: CollisionTree
    subspaces: StoredSubspaces


def learn(rolled: RollOuts, simulator: Simulator, encoder: Encoder, rho_mm: float, order: int) -> Models:
    """Fits all four models.

    Args:
        rolled: roll-outs, of which some touch the part and some collide with it.
        simulator: what they were rolled out with.
        encoder: what reads the widths.
        rho_mm: what one radian weighs.
        order: rotational order of the part.

    Raises:
        ValueError: no roll-out touches the part, or there are too few.
    """
    stands = rolled.status == COLLIDES
    free = RollOuts(*(column[~stands] for column in rolled))
    kcde = Kcde.fit(free, simulator.outline, simulator.jaws, rho_mm, order, paper=True)
    subspaces = subspaces_of(free.width_mm, encoder)
    stored = Projection.fit(free.final, subspaces.label(free.width_mm), rho_mm, order)
    return Models(
        motion=KernelMotion(kcde, simulator.workers),
        sensor=SensorModel.fit(free.final, free.width_mm, order),
        collision=CollisionTree.fit(rolled.initial, stands, order),
        subspaces=StoredSubspaces(subspaces, stored),
    )
