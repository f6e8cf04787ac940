"""The actions: where the open hand may be placed, and how far it stays clear of the part there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.belief.metric import Metric
from planner.frames import to_hand
from planner.job import Job
from planner.kernel import kernel
from planner.mechanics.clearance import blocked, clearance
from planner.mechanics.contacts import place
from planner.search.proposals import Proposals, proposals_of

SIDE_MARGIN_MM = 1.0
"""The fingers count as this much longer at both ends when clearance is judged."""
MAIN_MODES = 2
LEAST_MODE = 0.1
"""A mode that explains less of the belief than this is no reason for a placement."""


@dataclass(frozen=True, slots=True, eq=False)
class ActionSet:
    """Hand placements to choose from.

    Attributes:
        placements: (k, 3) the fixed ones: the hand frame in the world [mm, mm, rad].
        proposals: those relative to a belief; None for none.
        area: ((x_min, y_min), (x_max, y_max)) that the hand may be placed in.
    """

    placements: Array
    proposals: Proposals | None
    area: Array

    def __len__(self) -> int:
        return len(self.placements)

    def options(self, belief: Array, metric: Metric) -> Array:
        """The fixed placements, those beside them and those about the belief's main modes, within the area.

        Returns:
            (k, 3); the fixed ones alone where nothing is proposed.
        """
        if self.proposals is None:
            return self.placements
        modes = metric.main_modes(belief, MAIN_MODES, LEAST_MODE)
        near = [self.proposals.about(mode.pose) for mode in modes if mode.ratio >= LEAST_MODE]
        return self.within(np.concatenate([self.placements, self.proposals.beside(self.placements), *near]))

    def within(self, placements: Array) -> Array:
        """Those of the placements whose hand centre lies in the area."""
        inside = np.all((placements[:, :2] >= self.area[0]) & (placements[:, :2] <= self.area[1]), axis=1)
        return np.asarray(placements[inside])


def actions_of(job: Job) -> ActionSet:
    """Every angle at every centre of the job, in the order stated, and the job's proposals."""
    angles = np.radians(np.array(job.actions.angles_deg))
    centers = job.actions.centers_mm
    grid = [(x, y, angle) for x, y in centers for angle in angles]
    return ActionSet(np.array(grid, dtype=np.float64), proposals_of(job), np.array(job.cell.work_area_mm))


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


@kernel
def _free(
    outline: Array, reach: float, belief: Array, placements: Array, opening: float, h: float,
    thickness: float, least: float, spared: int, points: Array, listed: IntArray, free: BoolArray,
) -> None:  # fmt: skip
    """`free[a]`: whether the fingers at placement a keep `least` from all but `spared` poses."""
    n = outline.shape[0]
    pose = np.empty(3)
    for a in range(placements.shape[0]):
        c, s = np.cos(placements[a, 2]), np.sin(placements[a, 2])
        near = 0
        for k in range(belief.shape[0]):
            dx, dy = belief[k, 0] - placements[a, 0], belief[k, 1] - placements[a, 1]
            pose[0], pose[1], pose[2] = c * dx + s * dy, c * dy - s * dx, belief[k, 2] - placements[a, 2]
            if abs(pose[1]) + reach + least <= 0.5 * opening or abs(pose[0]) - reach >= h:
                continue
            place(outline, pose, points, listed, n)
            for finger in (1, -1):
                face = 0.5 * finger * opening
                if (
                    blocked(points, finger, face, h, thickness)
                    or max(clearance(points, finger, face, h), 0.0) < least
                ):
                    near += 1
                    break
            if near > spared:
                break
        free[a] = near <= spared


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


def free_placements(
    outline: Array, jaws: Array, belief: Array, placements: Array, least_mm: float, share: float = 0.0
) -> BoolArray:
    """Which placements keep a clearance of at least `least_mm` from every believed pose, or all but a few.

    With a share of 0 the same judgement as `least_clearance(...) >= least_mm`, without measuring what is far
    anyway.

    Args:
        outline: (N, 2) the part [mm].
        jaws: opening, finger length, finger thickness [mm].
        belief: (n, 3) believed poses in the world.
        placements: (k, 3) hand frames in the world.
        least_mm: clearance asked for, at most half the opening.
        share: of the poses that may be nearer.
    """
    n, free = len(outline), np.empty(len(placements), np.bool_)
    reach = float(np.max(np.hypot(*outline.T)))
    _free(
        outline, reach, np.ascontiguousarray(belief), np.ascontiguousarray(placements), jaws[0],
        0.5 * jaws[1] + SIDE_MARGIN_MM, jaws[2], least_mm, int(share * len(belief)), np.empty((n, 2)),
        np.arange(n), free,
    )  # fmt: skip
    return free
