"""The learned models as the paper prints them (V), all from one set of roll-outs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array
from planner.belief.observation import Encoder
from planner.learned.kcde import Kcde
from planner.learned.rollouts import COLLIDES, RollOuts
from planner.mechanics.simulator import Simulator
from planner.paper.projection import Projection
from planner.paper.sensor import CollisionTree, SensorModel
from planner.paper.subspaces import Subspaces, subspaces_of

Motion: TypeAlias = Callable[[Array, np.random.Generator], Array]
"""ForwardMotionModel-KCDE: draws final poses for initial ones, both (n, 3) in the hand frame."""


class Models(NamedTuple):
    """What is learned from the roll-outs before planning (paper VI, pre-planning steps 1 and 2)."""

    motion: Motion
    sensor: SensorModel
    collision: CollisionTree
    subspaces: Subspaces
    projection: Projection


def learn(rolled: RollOuts, simulator: Simulator, encoder: Encoder, rho_mm: float, order: int) -> Models:
    """Fits all models to roll-outs, of which some touch the part and some collide with it.

    `rho_mm` is what one radian weighs, `order` the part's rotational order.

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
