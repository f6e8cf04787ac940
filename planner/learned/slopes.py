"""How a squeeze's outcome changes with where the part lay: slopes of roll-outs, by differences.

Each roll-out is repeated from a slightly shifted and from a slightly turned pose with the same limit surface
and friction, so that nothing but the pose makes the difference. Outcomes have kinks, where the other end of a
face touches first, and jumps, where a part is held that would have slipped; a one-sided difference stays on
one side of a kink, and one that meets a jump is taken on the other side.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, IntArray
from planner.mechanics.simulator import Parameters, Simulator

OFFSET_MM = 0.02
"""Shift of the pose, and turn times rho."""
STEEPEST = 4.0
"""A normalised slope beyond this is a jump: the roll-out then counts as flat."""


def few(parameters: Parameters, rows: IntArray) -> Parameters:
    """The mechanics of some of the roll-outs."""
    surfaces, mu, release = parameters
    return Parameters(surfaces[rows], mu[rows], None if release is None else release[rows])


def slopes_of(simulator: Simulator, poses: Array, parameters: Parameters) -> Array:
    """Slopes of roll-outs.

    Args:
        simulator: what rolls them out.
        poses: (n, 3) where the parts lie, in the hand frame [mm, mm, rad].
        parameters: their mechanics.

    Returns:
        (n, 4, 3) change of x, y, theta and width with x, y and theta; zero where both sides jump.
    """
    before = _ends(simulator, poses, parameters)
    slope, steepest = _one_sided(simulator, poses, parameters, before, OFFSET_MM)
    jumps = np.flatnonzero(steepest > STEEPEST)
    other, still = _one_sided(simulator, poses[jumps], few(parameters, jumps), before[jumps], -OFFSET_MM)
    slope[jumps] = np.where(still[:, None, None] > STEEPEST, 0.0, other)
    return slope


def _ends(simulator: Simulator, poses: Array, parameters: Parameters) -> Array:
    """Final poses and widths, (n, 4)."""
    rolled = simulator.roll_out(poses, parameters)
    return np.column_stack([rolled.poses, rolled.width_mm])


def _one_sided(
    simulator: Simulator, poses: Array, parameters: Parameters, before: Array, offset: float
) -> tuple[Array, Array]:
    """Differences (n, 4, 3), and the largest normalised entry of each (n,)."""
    rho = simulator.surface.rho_mm
    slope = np.zeros((len(poses), 4, 3))
    for column, unit in enumerate((1.0, 1.0, rho)):
        moved = poses.copy()
        moved[:, column] += offset / unit
        slope[:, :, column] = (_ends(simulator, moved, parameters) - before) * (unit / offset)
    size = np.abs(slope) * np.array([1.0, 1.0, rho, 1.0])[:, None] / np.array([1.0, 1.0, rho])
    return slope, np.max(size, axis=(1, 2), initial=0.0)
