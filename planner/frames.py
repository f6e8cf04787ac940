"""Converts poses between hand frame and world. In the hand frame, jaws close along y, fingers lie along x."""

import numpy as np

from planner.arrays import Array


def to_hand(poses: Array, placement: Array) -> Array:
    """Converts poses (..., 3) in the world [mm, mm, rad] to the frame of a hand at `placement` (3,)."""
    c, s = np.cos(placement[2]), np.sin(placement[2])
    dx, dy = poses[..., 0] - placement[0], poses[..., 1] - placement[1]
    return np.stack([c * dx + s * dy, c * dy - s * dx, poses[..., 2] - placement[2]], axis=-1)


def to_world(poses: Array, placement: Array) -> Array:
    """Converts poses (..., 3) in the frame of a hand at `placement` (3,) to the world [mm, mm, rad]."""
    c, s = np.cos(placement[2]), np.sin(placement[2])
    x, y = poses[..., 0], poses[..., 1]
    return np.stack(
        [placement[0] + c * x - s * y, placement[1] + s * x + c * y, poses[..., 2] + placement[2]],
        axis=-1,
    )


def wrap(angle: Array, order: int = 1) -> Array:
    """Reduces angles [rad] to within half a period of zero; the period is 2 pi / `order`."""
    period = 2.0 * np.pi / order
    return np.asarray(angle - period * np.round(angle / period))
