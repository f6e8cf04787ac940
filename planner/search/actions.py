"""The actions: where the open hand may be placed, and how far it stays clear of the part there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, IntArray
from planner.frames import to_hand
from planner.job import Job
from planner.kernel import kernel
from planner.mechanics.clearance import blocked, clearance
from planner.mechanics.contacts import place

SIDE_MARGIN_MM = 1.0
"""The fingers count as this much longer at both ends when clearance is judged."""


@dataclass(frozen=True, slots=True, eq=False)
class ActionSet:
    """Hand placements to choose from.

    Attributes:
        placements: (k, 3) the hand frame in the world [mm, mm, rad].
    """

    placements: Array

    def __len__(self) -> int:
        return len(self.placements)


def actions_of(job: Job) -> ActionSet:
    """Every angle at every centre of the job, in the order stated."""
    angles = np.radians(np.array(job.actions.angles_deg))
    centers = job.actions.centers_mm
    grid = [(x, y, angle) for x, y in centers for angle in angles]
    return ActionSet(np.array(grid, dtype=np.float64))


@kernel
def _least_clearance(outline: Array, poses: Array, opening: float, h: float, thickness: float, points: Array,
                     listed: IntArray) -> float:  # fmt: skip
    """Least distance along y between the open fingers and any of the poses; -1 in collision [mm]."""
    n = outline.shape[0]
    least = 0.5 * opening
    for k in range(poses.shape[0]):
        place(outline, poses[k], points, listed, n)
        for finger in (1, -1):
            face = 0.5 * finger * opening
            if blocked(points, finger, face, h, thickness):
                return -1.0
            least = min(least, max(clearance(points, finger, face, h), 0.0))
    return least


def least_clearance(
    outline: Array, jaws: Array, poses: Array, placement: Array, margin_mm: float = SIDE_MARGIN_MM
) -> float:
    """Distance between the open fingers at a placement and the nearest of the believed parts [mm].

    Measured along the closing direction.

    Args:
        outline: (N, 2) the part [mm].
        jaws: opening, finger length, finger thickness [mm].
        poses: (n, 3) believed poses in the world.
        placement: (3,) the hand frame in the world.
        margin_mm: the fingers count as this much longer at both ends.

    Returns:
        At most half the opening; -1 where a finger would stand on the part.
    """
    hand = np.ascontiguousarray(to_hand(poses, placement))
    n = len(outline)
    return float(
        _least_clearance(
            outline, hand, jaws[0], 0.5 * jaws[1] + margin_mm, jaws[2], np.empty((n, 2)), np.arange(n)
        )
    )
