"""A whole squeeze: the fingers close until the part is held, or until they meet.

Free motion is skipped exactly (`contacts.clearance`). Contact motion follows the midpoint rule on the
displacement-level LCP of `step.py`; the difference to the explicit Euler step controls its length, and a step
in which a new contact would touch ends there. Where the LCP has no solution the part is held (paper, section
IV: "the no-solution case corresponds to the object being jammed or grasped"): *grasped* where no motion of
the part at all lets the fingers close further, *jammed* where friction alone prevents it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import kernel
from planner.mechanics import contacts as contact
from planner.mechanics.contacts import C_COLUMNS, GAP, I_COLUMNS, MAX_CONTACTS
from planner.mechanics.step import (
    SOLVED,
    StepWork,
    directions,
    event_fraction,
    rotate_surface,
    solve,
    turn,
    workspace,
)

UNTOUCHED = 0
SLIPPED = 1
GRASPED = 2
JAMMED = 3
STATUS_NAMES = ("untouched", "slipped", "grasped", "jammed")

PENETRATION_MM = 0.01
"""Overlap at which a step is refused."""
LARGEST_TURN = 0.1
"""Largest rotation in one step [rad]."""
EULER_ERROR = 0.05
"""Largest difference between Euler and midpoint step, as a share of the nominal step."""
SMALLEST_STEP = 1.0 / 256.0
MAX_STEPS = 20_000
NEAR_MM = 3.0
"""How far around the fingers vertices are followed between two looks at the whole outline."""


class SqueezeWork(NamedTuple):
    """Workspace of one squeeze: contacts, step, placed outline, listed vertices and scratch vectors."""

    C: Array
    I: IntArray
    step: StepWork
    points: Array
    placed: IntArray
    near: IntArray
    A: Array
    V: Array
    trial: Array
    half: Array


def squeeze_workspace(vertices: int) -> SqueezeWork:
    """A workspace for an outline of that many vertices."""
    return SqueezeWork(
        C=np.zeros((MAX_CONTACTS, C_COLUMNS)), I=np.zeros((MAX_CONTACTS, I_COLUMNS), np.int64), step=workspace(),
        points=np.zeros((vertices, 2)), placed=np.zeros(vertices, np.int64), near=np.zeros(vertices, np.int64),
        A=np.zeros((3, 3)), V=np.zeros(3), trial=np.zeros(3), half=np.zeros(3),
    )  # fmt: skip


@kernel
def _advance(
    A: Array, rho: float, mu_top: float, mu_bottom: float, q: Array, top: float, bottom: float, h: float,
    step_top: float, step_bottom: float, count: int, work: SqueezeWork,
) -> tuple[int, float]:  # fmt: skip
    """One midpoint step from pose q into `work.trial`, for contacts already found at q.

    Returns the status and the difference between the Euler and the midpoint step [mm].
    """
    C, I, V, Ah = work.C, work.I, work.V, work.A
    rotate_surface(A, q[2], Ah)
    directions(C, I, count, rho, step_top, step_bottom)
    status = solve(Ah, mu_top, mu_bottom, C, I, count, work.step, V)
    if status != SOLVED:
        return status, -1.0
    v0, v1, v2 = V[0], V[1], V[2]
    work.half[0] = q[0] + 0.5 * v0
    work.half[1] = q[1] + 0.5 * v1
    work.half[2] = q[2] + 0.5 * v2 / rho
    turn(C, I, count, q, work.half, top - 0.5 * step_top, bottom + 0.5 * step_bottom, h)
    rotate_surface(A, work.half[2], Ah)
    directions(C, I, count, rho, step_top, step_bottom)
    status = solve(Ah, mu_top, mu_bottom, C, I, count, work.step, V)
    if status != SOLVED:
        return status, 0.0
    work.trial[0] = q[0] + V[0]
    work.trial[1] = q[1] + V[1]
    work.trial[2] = q[2] + V[2] / rho
    return SOLVED, np.sqrt((V[0] - v0) ** 2 + (V[1] - v1) ** 2 + (V[2] - v2) ** 2)


@kernel
def _list_near(points: Array, top: float, bottom: float, near: IntArray, placed: IntArray) -> tuple[int, int]:
    """Lists the vertices near the fingers' faces, and those with their neighbours; returns both counts."""
    n = points.shape[0]
    near_count, placed_count = 0, 0
    high, low = top - NEAR_MM, bottom + NEAR_MM
    before = points[n - 1, 1] > high or points[n - 1, 1] < low
    here = points[0, 1] > high or points[0, 1] < low
    first = here
    for i in range(n):
        after = first
        if i + 1 < n:
            after = points[i + 1, 1] > high or points[i + 1, 1] < low
        if here or after:
            near[near_count] = i
            near_count += 1
        if before or here or after:
            placed[placed_count] = i
            placed_count += 1
        before, here = here, after
    return near_count, placed_count


@kernel
def _overlap(C: Array, count: int) -> float:
    """Deepest overlap among the contacts found [mm]."""
    deepest = 0.0
    for k in range(count):
        deepest = max(deepest, -C[k, GAP])
    return deepest


@kernel
def _held_as(
    A: Array, rho: float, q: Array, top: float, bottom: float, h: float, thickness: float, near_count: int,
    work: SqueezeWork,
) -> int:  # fmt: skip
    """GRASPED where the part is blocked without friction too, else JAMMED."""
    C, I = work.C, work.I
    count = contact.find(C, I, work.points, work.near, near_count, q, top, bottom, h, thickness, 0.02)
    for k in range(count):
        C[k, GAP] = 0.0
    rotate_surface(A, q[2], work.A)
    directions(C, I, count, rho, 0.1, 0.1)
    return JAMMED if solve(work.A, 0.0, 0.0, C, I, count, work.step, work.V) == SOLVED else GRASPED


@kernel
def squeeze(
    outline: Array, reach: float, A: Array, rho: float, mu_top: float, mu_bottom: float, jaws: Array,
    step: float, q: Array, work: SqueezeWork,
) -> tuple[float, int, int]:  # fmt: skip
    """Closes the fingers on one part.

    Args:
        outline: (N, 2) counter-clockwise, in the part's frame [mm].
        reach: largest distance of a vertex from the part's origin [mm].
        A: (3, 3) limit surface matrix in the part's frame, normalised by rho.
        rho: radius of gyration of the support [mm].
        mu_top: friction at the upper finger.
        mu_bottom: friction at the lower finger.
        jaws: (4,) opening, finger length, finger thickness [mm] and the upper finger's share of the closing
            motion (0.5 = both alike).
        step: nominal closing step of each finger [mm].
        q: (3,) pose in the hand frame [mm, mm, rad]; modified in place into the final pose.
        work: workspace, modified in place.

    Returns:
        Final width [mm], status, and 1 where the squeeze had to be given up (0 in a sound squeeze).
    """
    C, I, points = work.C, work.I, work.points
    h, thickness = 0.5 * jaws[1], jaws[2]
    top_share, bottom_share = 2.0 * jaws[3], 2.0 * (1.0 - jaws[3])
    top, bottom = 0.5 * jaws[0], -0.5 * jaws[0]
    touched, fresh = False, False
    n = outline.shape[0]
    near_count, placed_count, count = 0, 0, 0
    budget = 0.0
    size = step
    margin = 2.0 * step + 0.05
    status = SOLVED
    for _ in range(MAX_STEPS):
        if budget < margin:
            for i in range(n):
                work.placed[i] = i
            contact.place(outline, q, points, work.placed, n)
            if not touched:
                if contact.overlap(points, top, bottom, h, thickness) > PENETRATION_MM:
                    return top - bottom, JAMMED, 0
            free = np.inf
            if top_share > 0.0:
                free = contact.clearance(points, 1, top, h) / top_share
            if bottom_share > 0.0:
                free = min(free, contact.clearance(points, -1, bottom, h) / bottom_share)
            if free > 0.5 * (top - bottom):
                return 0.0, SLIPPED if touched else UNTOUCHED, 0
            if free > 0.0:
                top -= top_share * free
                bottom += bottom_share * free
            near_count, placed_count = _list_near(points, top, bottom, work.near, work.placed)
            budget = NEAR_MM
            fresh = False
        if not fresh:
            count = contact.find(C, I, points, work.near, near_count, q, top, bottom, h, thickness, margin)
            fresh = True
            if count == 0 and budget < NEAR_MM:
                budget = 0.0
                continue
        touched = True
        size = min(size, 0.5 * (top - bottom))
        step_top, step_bottom = top_share * size, bottom_share * size
        status, error = _advance(A, rho, mu_top, mu_bottom, q, top, bottom, h, step_top, step_bottom, count, work)
        fresh = False
        smallest = size <= step * SMALLEST_STEP
        if status != SOLVED:
            if error < 0.0 or smallest:
                break
            size *= 0.25
            continue
        turned = abs(work.trial[2] - q[2])
        if (error > EULER_ERROR * step or turned > LARGEST_TURN) and not smallest:
            size *= max(0.2, min(0.8 * np.sqrt(EULER_ERROR * step / (error + 1e-12)), 0.8 * LARGEST_TURN / turned))
            continue
        fraction = event_fraction(C, count, work.V)
        if fraction < 0.95 and not smallest:
            size *= max(fraction, SMALLEST_STEP)
            continue
        contact.place(outline, work.trial, points, work.placed, placed_count)
        new_top, new_bottom = top - step_top, bottom + step_bottom
        count = contact.find(
            C, I, points, work.near, near_count, work.trial, new_top, new_bottom, h, thickness, margin
        )
        if _overlap(C, count) > PENETRATION_MM:
            if smallest:
                break
            contact.place(outline, q, points, work.placed, placed_count)
            size *= 0.25
            continue
        fresh = True
        dx, dy = work.trial[0] - q[0], work.trial[1] - q[1]
        budget -= np.sqrt(dx * dx + dy * dy) + turned * reach + max(step_top, step_bottom)
        q[0], q[1], q[2] = work.trial[0], work.trial[1], work.trial[2]
        top, bottom = new_top, new_bottom
        if top - bottom <= 1e-6:
            return 0.0, SLIPPED, 0
        size = min(step, size * min(2.0, 0.8 * np.sqrt(EULER_ERROR * step / (error + 1e-12))))
    held = _held_as(A, rho, q, top, bottom, h, thickness, near_count, work)
    return top - bottom, held, 1 if status == SOLVED else 0


@kernel
def squeeze_many(
    outline: Array, A: Array, rho: float, mu: Array, jaws: Array, step: float, poses: Array, width: Array,
    status: IntArray, forced: IntArray, work: SqueezeWork,
) -> None:  # fmt: skip
    """`squeeze` for every row of `poses` (n, 3) with its own A (n, 3, 3) and mu (n, 2); outputs in place."""
    reach = 0.0
    for i in range(outline.shape[0]):
        reach = max(reach, np.sqrt(outline[i, 0] ** 2 + outline[i, 1] ** 2))
    for i in range(poses.shape[0]):
        width[i], status[i], forced[i] = squeeze(
            outline, reach, A[i], rho, mu[i, 0], mu[i, 1], jaws, step, poses[i], work
        )
