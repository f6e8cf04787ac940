"""The sensor model and the collision detector (paper V.B): decision trees over poses.

The trees use x, y and the angle as (cos n theta, sin n theta), with n the part's rotational order, so that
equivalent angles have equal features.
"""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array, BoolArray

LEAST_ROLLOUTS = 10

Widths: TypeAlias = Callable[[Array], Array]
"""SensorModel-RegressionTree: expected widths (n,) of final poses (n, 3) in the hand frame [mm]."""
Collides: TypeAlias = Callable[[Array], BoolArray]
"""CollisionFree-DecisionTree: mask (n,) of the poses at which an open finger would stand on the part.

The poses (n, 3) of the part are in the hand frame. The default planner uses `mechanics.clearance` instead.
"""


def sensor_model(final: Array, width_mm: Array, order: int) -> Widths:
    """Fits the sensor model to final poses (n, 3) in the hand frame and the widths (n,) there [mm].

    Raises:
        ValueError: fewer than `LEAST_ROLLOUTS` roll-outs.
    """
    # Importing sklearn takes two seconds; most plans learn nothing.
    from sklearn.tree import DecisionTreeRegressor

    if len(final) < LEAST_ROLLOUTS:
        raise ValueError(f"{len(final)} roll-outs are too few for a sensor model; ask for more")
    return _fitted(DecisionTreeRegressor(random_state=0), final, width_mm, order)


def collision_detector(initial: Array, stands: BoolArray, order: int) -> Collides:
    """Fits the detector to initial poses (n, 3), of which the mask `stands` (n,) marks the collisions."""
    from sklearn.tree import DecisionTreeClassifier

    return _fitted(DecisionTreeClassifier(random_state=0), initial, stands, order)


def _fitted(tree: Any, known: Array, values: Array | BoolArray, order: int) -> Callable[..., Any]:
    """Fits a tree to the values (n,) of known poses (n, 3); returns a function that predicts by this tree."""
    tree.fit(features(known, order), values)

    def predict(poses: Array) -> Any:
        return tree.predict(features(poses, order))

    return predict


def features(poses: Array, order: int) -> NDArray[np.float32]:
    """Features (n, 4) of poses (n, 3): x, y, and cosine and sine of `order` times the angle."""
    turned = order * poses[:, 2]
    columns = [poses[:, 0], poses[:, 1], np.cos(turned), np.sin(turned)]
    return np.column_stack(columns).astype(np.float32)
