"""SingletonRatio as the paper prints it (VI.1): the share of a belief in a box about its average pose.

The average of a belief of two modes lies between them, so its ratio is near 0 whatever one does.
`planner.belief.metric` has the mode ratio that the default method uses instead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray
from planner.belief.metric import Mode
from planner.frames import wrap

PRINTED_ORDER = 2  # The paper maps theta to [cos 2 theta, sin 2 theta]


class Tolerances(NamedTuple):
    """The box about the average pose: plus and minus each of these (paper, VII)."""

    x_mm: float = 2.5  # along x of the world
    y_mm: float = 2.5  # along y of the world
    theta_rad: float = math.radians(5.0)  # orientation, under the part's symmetry


def average_pose(poses: Array, order: int = PRINTED_ORDER) -> Array:
    """Average (3,) of x, y, cos(n theta), sin(n theta) of poses (m, 3), mapped back; n is the order."""
    x, y = poses[:, 0].mean(), poses[:, 1].mean()
    turned = order * poses[:, 2]
    theta = math.atan2(np.sin(turned).mean(), np.cos(turned).mean()) / order
    return np.array([x, y, theta])


def within(poses: Array, pose: Array, tolerances: Tolerances, order: int = PRINTED_ORDER) -> BoolArray:
    """Where poses (m, 3) lie within the box about a pose (3,)."""
    offset = np.abs(poses - pose)
    turn = np.abs(wrap(poses[:, 2] - pose[2], order))
    near = (offset[:, 0] <= tolerances.x_mm) & (offset[:, 1] <= tolerances.y_mm)
    return np.asarray(near & (turn <= tolerances.theta_rad))


def singleton(poses: Array, tolerances: Tolerances, order: int = PRINTED_ORDER) -> Mode:
    """SingletonRatio(X, eps): the average pose of particles (m, 3), and the share in the box about it."""
    pose = average_pose(poses, order)
    return Mode(pose, float(within(poses, pose, tolerances, order).mean()))
