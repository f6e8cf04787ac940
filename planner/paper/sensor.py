"""The sensor model and the collision detector (paper V.B): decision trees over poses.

The trees use x, y and the angle as (cos n theta, sin n theta), n the part's rotational order, which has no
seam.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, BoolArray

if TYPE_CHECKING:
    from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

LEAST_ROLLOUTS = 10


@dataclass(frozen=True, slots=True, eq=False)
class SensorModel:
    """A regression tree from final poses to widths."""

    tree: DecisionTreeRegressor  # on the columns of `features`
    order: int  # rotational order of the part

    @classmethod
    def fit(cls, final: Array, width_mm: Array, order: int) -> Self:
        """Learns from final poses (n, 3) in the hand frame and their widths (n,) [mm].

        Raises:
            ValueError: there are fewer than `LEAST_ROLLOUTS` roll-outs.
        """
        # Importing sklearn takes two seconds; most plans learn nothing.
        from sklearn.tree import DecisionTreeRegressor

        if len(final) < LEAST_ROLLOUTS:
            raise ValueError(f"{len(final)} roll-outs are too few for a sensor model; ask for more")
        tree = DecisionTreeRegressor(random_state=0)
        return cls(tree.fit(features(final, order), width_mm), order)

    def predict(self, poses: Array) -> Array:
        """Expected widths (n,) of final poses (n, 3) in the hand frame [mm]."""
        return np.asarray(self.tree.predict(features(poses, self.order)))


@dataclass(frozen=True, slots=True, eq=False)
class CollisionTree:
    """CollisionFree-DecisionTree, learned from roll-outs. The default planner uses `mechanics.clearance`."""

    tree: DecisionTreeClassifier
    order: int

    @classmethod
    def fit(cls, initial: Array, stands: BoolArray, order: int) -> Self:
        """Learns from initial poses (n, 3) and whether an open finger stands on the part (n,)."""
        from sklearn.tree import DecisionTreeClassifier

        tree = DecisionTreeClassifier(random_state=0)
        return cls(tree.fit(features(initial, order), stands), order)

    def collides(self, poses: Array) -> BoolArray:
        """Where an open finger would stand on the part; poses are (n, 3) in the hand frame."""
        return np.asarray(self.tree.predict(features(poses, self.order)), dtype=np.bool_)


def features(poses: Array, order: int) -> NDArray[np.float32]:
    """Features of the trees: (n, 4) x, y, cos and sin of the angle under the symmetry."""
    turned = order * poses[:, 2]
    columns = [poses[:, 0], poses[:, 1], np.cos(turned), np.sin(turned)]
    return np.column_stack(columns).astype(np.float32)
