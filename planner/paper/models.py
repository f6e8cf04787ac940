"""The learned models as the paper prints them (V), all from one set of roll-outs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Self, TypeAlias

import numpy as np

from planner.arrays import Array, BoolArray
from planner.belief.observation import Encoder
from planner.learned.kcde import Kcde
from planner.learned.rollouts import COLLIDES, RollOuts
from planner.mechanics.simulator import Simulator
from planner.paper.projection import Projection
from planner.paper.sensor import SensorModel, features
from planner.paper.subspaces import Subspaces, subspaces_of

if TYPE_CHECKING:
    from sklearn.tree import DecisionTreeClassifier


Motion: TypeAlias = Callable[[Array, np.random.Generator], Array]
"""ForwardMotionModel-KCDE: draws final poses for initial ones, both (n, 3) in the hand frame."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionTree:
    """CollisionFree-DecisionTree: what roll-outs found. The planner itself goes by `mechanics.clearance`."""

    tree: DecisionTreeClassifier
    order: int

    @classmethod
    def fit(cls, initial: Array, stands: BoolArray, order: int) -> Self:
        """Learns from initial poses (n, 3) where an open finger stands on the part (n,)."""
        from sklearn.tree import DecisionTreeClassifier  # takes two seconds; most plans learn nothing

        tree = DecisionTreeClassifier(random_state=0)
        return cls(tree.fit(features(initial, order), stands), order)

    def collides(self, poses: Array) -> BoolArray:
        """Where an open finger would stand on the part; poses are (n, 3) in the hand frame."""
        return np.asarray(self.tree.predict(features(poses, self.order)), dtype=np.bool_)


class Models(NamedTuple):
    """What is learned from the roll-outs before planning (paper VI, pre-planning steps 1 and 2)."""

    motion: Motion
    sensor: SensorModel
    collision: CollisionTree
    subspaces: Subspaces
    projection: Projection


def learn(rolled: RollOuts, simulator: Simulator, encoder: Encoder, rho_mm: float, order: int) -> Models:
    """Fits all models.

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
    return Models(
        motion=lambda poses, rng: kcde.sample(poses, rng, simulator.workers).poses,
        sensor=SensorModel.fit(free.final, free.width_mm, order),
        collision=CollisionTree.fit(rolled.initial, stands, order),
        subspaces=subspaces,
        projection=Projection.fit(free.final, subspaces.label(free.width_mm), rho_mm, order),
    )
