"""Clearance between fingers and a part at rest: overlap, distance to first touch, kind of contact."""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.frames import to_hand
from planner.job.schema import Gripper
from planner.kernel import inlined_kernel, inner_kernel, kernel
from planner.mechanics.contacts import place

BEHIND_MM = 0.1
"""Distance behind an inner face beyond which a point is beside or behind the finger, not before it."""
SIDE_MARGIN_MM = 1.0
"""Length added to both ends of the fingers when the clearance of a placement is judged."""

MISSES = 0
TOUCHES = 1
STANDS_ON = 2  # Verdicts of `classify_contact`


class Jaws(NamedTuple):
    """The jaws of a gripper, open."""

    opening_mm: float
    length_mm: float  # length of a finger, along x of the hand frame
    thickness_mm: float  # thickness of a finger, along the closing direction
    upper_share: float  # share of the closing that the upper finger makes


def jaws_of(gripper: Gripper) -> Jaws:
    """The jaws of a job's gripper."""
    length_mm, thickness_mm = gripper.finger_length_mm, gripper.finger_width_mm
    return Jaws(gripper.opening_mm, length_mm, thickness_mm, gripper.upper_finger_share)


@inner_kernel
def clearance(points: Array, finger: int, face: float, h: float) -> float:
    """Distance that a finger can close before it touches the part [mm]: exact, by rays along y.

    Args:
        points: (2, N) outline of the part in the hand frame [mm].
        finger: 1 for the upper finger, which looks down; -1 for the lower.
        face: y of the finger's inner face [mm].
        h: half the length of the finger [mm].

    Returns:
        The distance; infinite where the part lies beside or behind the finger.
    """
    n = points.shape[1]
    nearest = np.inf
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[0, i], points[1, i], points[0, j], points[1, j]
        gap = finger * (face - y0)
        if abs(x0) <= h and gap > -BEHIND_MM:
            nearest = min(nearest, gap)
        for side in (-1, 1):
            x = side * h
            if (x0 - x) * (x1 - x) < 0.0:
                gap = finger * (face - y0 - (y1 - y0) * (x - x0) / (x1 - x0))
                if gap > -BEHIND_MM:
                    nearest = min(nearest, gap)
    return nearest


@inlined_kernel
def crosses(x0: float, y0: float, x1: float, y1: float, half_x: float, half_y: float) -> bool:
    """Whether a segment runs through the inside of the box |x| < half_x, |y| < half_y (Liang and Barsky)."""
    start, end = 0.0, 1.0
    for origin, step, half in ((x0, x1 - x0, half_x), (y0, y1 - y0, half_y)):
        if abs(step) < 1e-12:
            if abs(origin) >= half:
                return False
        else:
            enter, leave = (-half - origin) / step, (half - origin) / step
            start, end = max(start, min(enter, leave)), min(end, max(enter, leave))
    return end - start > 1e-9


@inner_kernel
def blocked(points: Array, finger: int, face: float, h: float, thickness: float) -> bool:
    """Whether the part overlaps the box of a finger, so that the finger cannot be set down.

    `thickness` is the thickness of the finger [mm]; the other arguments are those of `clearance`.
    """
    n = points.shape[1]
    inside = False
    half, middle = 0.5 * thickness, face + 0.5 * finger * thickness
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[0, i], points[1, i] - middle, points[0, j], points[1, j] - middle
        if (y0 >= half and y1 >= half) or (y0 <= -half and y1 <= -half):
            continue
        if (y0 > 0.0) != (y1 > 0.0) and x0 + (x1 - x0) * y0 / (y0 - y1) > 0.0:
            inside = not inside
        if crosses(x0, y0, x1, y1, h, half):
            return True
    return inside


@inner_kernel
def stand(points: Array, top: float, bottom: float, h: float, thickness: float) -> bool:
    """Whether one of two fingers overlaps the part; their inner faces are at y = top and y = bottom [mm].

    Such a finger cannot be set down.
    """
    return blocked(points, 1, top, h, thickness) or blocked(points, -1, bottom, h, thickness)


@inner_kernel
def free_closing(
    points: Array, top: float, bottom: float, h: float, top_share: float, bottom_share: float
) -> float:
    """Mean distance that the two fingers move before either touches the part [mm]; infinite if neither does.

    Args:
        points: (2, N) outline of the part in the hand frame [mm].
        top: y of the upper finger's inner face [mm].
        bottom: y of the lower finger's inner face [mm].
        h: half the length of a finger [mm].
        top_share: motion of the upper finger for each millimetre of the fingers' mean motion.
        bottom_share: the same for the lower finger.
    """
    free = np.inf
    if top_share > 0.0:
        free = clearance(points, 1, top, h) / top_share
    if bottom_share > 0.0:
        free = min(free, clearance(points, -1, bottom, h) / bottom_share)
    return free


@inner_kernel
def _room(points: Array, opening: float, h: float, thickness: float) -> float:
    """Least distance along y between the open fingers and the part [mm]; -1 if a finger stands on the part.

    The result is at most half the opening.
    """
    top = 0.5 * opening
    if stand(points, top, -top, h, thickness):
        return -1.0
    room = min(top, clearance(points, 1, top, h), clearance(points, -1, -top, h))
    return max(room, 0.0)


@kernel
def _classify(outline: Array, poses: Array, jaws: Jaws, verdict: IntArray) -> None:
    """`classify_contact` for an outline (2, N); writes the results into `verdict` (n,)."""
    points = np.empty(outline.shape)
    h, top, upper = 0.5 * jaws.length_mm, 0.5 * jaws.opening_mm, jaws.upper_share
    for k in range(poses.shape[0]):
        place(outline, poses[k], points)
        if stand(points, top, -top, h, jaws.thickness_mm):
            verdict[k] = STANDS_ON
        elif free_closing(points, top, -top, h, 2.0 * upper, 2.0 * (1.0 - upper)) <= top:
            verdict[k] = TOUCHES
        else:
            verdict[k] = MISSES


def classify_contact(outline: Array, jaws: Jaws, poses: Array) -> IntArray:
    """Classifies the first contact of closing fingers with a part (N, 2) at `poses` (n, 3) in the hand frame.

    Returns:
        (n,) `TOUCHES`; `MISSES` where the fingers meet each other first; `STANDS_ON` where an open finger
        would come down on the part.
    """
    verdict = np.zeros(len(poses), np.int64)
    _classify(np.ascontiguousarray(outline.T), np.ascontiguousarray(poses), jaws, verdict)
    return verdict


@kernel
def _least_room(outline: Array, poses: Array, opening: float, h: float, thickness: float) -> float:
    """Least distance along y between the open fingers and a part at any of `poses` (n, 3) [mm].

    The poses are in the hand frame. The result is at most half the opening, and -1 if a finger stands on the
    part at any pose.
    """
    points = np.empty(outline.shape)
    least = 0.5 * opening
    for k in range(poses.shape[0]):
        place(outline, poses[k], points)
        least = min(least, _room(points, opening, h, thickness))
        if least < 0.0:
            break
    return least


@kernel
def _free(
    outline: Array,
    belief: Array,
    placements: Array,
    jaws: Jaws,
    least: float,
    spared: int,
    free: BoolArray,
) -> None:
    """Writes into `free` (k,) whether the open fingers clear the part by `least` [mm] at each placement.

    The clearance may be smaller at up to `spared` poses of the belief.
    """
    h, points, pose = 0.5 * jaws.length_mm + SIDE_MARGIN_MM, np.empty(outline.shape), np.empty(3)
    reach = np.sqrt((outline[0] ** 2 + outline[1] ** 2).max())
    for a in range(placements.shape[0]):
        c, s = np.cos(placements[a, 2]), np.sin(placements[a, 2])
        near = 0
        for k in range(belief.shape[0]):
            dx, dy = belief[k, 0] - placements[a, 0], belief[k, 1] - placements[a, 1]
            pose[0], pose[1], pose[2] = (
                c * dx + s * dy,
                c * dy - s * dx,
                belief[k, 2] - placements[a, 2],
            )
            if abs(pose[1]) + reach + least <= 0.5 * jaws.opening_mm or abs(pose[0]) - reach >= h:
                continue
            place(outline, pose, points)
            if _room(points, jaws.opening_mm, h, jaws.thickness_mm) < least:
                near += 1
                if near > spared:
                    break
        free[a] = near <= spared


def least_clearance(
    outline: Array, jaws: Jaws, poses: Array, placement: Array, margin_mm: float = SIDE_MARGIN_MM
) -> float:
    """Least distance along the closing direction between open fingers and the part, over a belief [mm].

    The part has the outline (N, 2) [mm] and lies at any of the believed poses (n, 3) in the world. The hand
    is at the pose `placement` (3,) in the world. The fingers count as `margin_mm` longer at both ends.

    Returns:
        The distance, at most half the opening; -1 where a finger would stand on the part.
    """
    hand = np.ascontiguousarray(to_hand(poses, placement))
    columns, h = np.ascontiguousarray(outline.T), 0.5 * jaws.length_mm + margin_mm
    return float(_least_room(columns, hand, jaws.opening_mm, h, jaws.thickness_mm))


@kernel
def _first_contacts(
    outline: Array, jaws: Jaws, poses: Array, share: Array, width_mm: Array
) -> None:
    """`first_contacts_mm` for an outline (2, N); writes the results into `width_mm` (n,)."""
    points, top = np.empty(outline.shape), 0.5 * jaws.opening_mm
    h = 0.5 * jaws.length_mm + SIDE_MARGIN_MM
    for k in range(poses.shape[0]):
        place(outline, poses[k], points)
        free = free_closing(points, top, -top, h, 2.0 * share[k], 2.0 * (1.0 - share[k]))
        width_mm[k] = jaws.opening_mm - 2.0 * max(min(free, top), 0.0)


def first_contacts_mm(outline: Array, jaws: Jaws, poses: Array, share: Array) -> Array:
    """For each pose of a part, an upper bound (n,) on the width at which closing jaws first touch it [mm].

    The bound is 0 where the jaws never touch the part. It counts the fingers as `SIDE_MARGIN_MM` longer at
    both ends.

    Args:
        outline: (N, 2) outline of the part [mm].
        jaws: the fingers and their opening.
        poses: (n, 3) poses of the part in the hand frame [mm, mm, rad].
        share: (n,) share of the closing that the upper finger makes.
    """
    width_mm = np.empty(len(poses))
    poses, columns = np.ascontiguousarray(poses), np.ascontiguousarray(outline.T)
    _first_contacts(columns, jaws, poses, share, width_mm)
    return width_mm


def free_placements(
    outline: Array,
    jaws: Jaws,
    belief: Array,
    placements: Array,
    least_mm: float,
    share: float = 0.0,
) -> BoolArray:
    """Mask (k,) of placements at which open fingers clear the part by at least `least_mm`.

    Placements (k, 3) and believed poses (n, 3) are in the world. The clearance may be smaller at a fraction
    `share` of the poses. If `share` is 0 and `least_mm` is at most half the opening, the mask equals
    `least_clearance(...) >= least_mm`, but takes less time.
    """
    free = np.empty(len(placements), np.bool_)
    belief, placements = np.ascontiguousarray(belief), np.ascontiguousarray(placements)
    columns, spared = np.ascontiguousarray(outline.T), int(share * len(belief))
    _free(columns, belief, placements, jaws, least_mm, spared, free)
    return free
