"""A whole squeeze: the fingers close until the part is held, or until they meet.

Free motion is skipped exactly (`contacts.clearance`); contact motion is stepped with the midpoint rule on the
displacement-level LCP of `step.py`. Where the LCP has no solution the step shrinks; when the smallest step has
none either, the part is held (paper, section IV: "the no-solution case corresponds to the object being jammed
or grasped"). It is *grasped* where no motion of the part at all lets the fingers close further, and *jammed*
where friction alone prevents it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planner.arrays import Array, IntArray
from planner.mechanics import contacts as contact
from planner.mechanics.contacts import Contacts
from planner.mechanics.lcp import SOLVED
from planner.mechanics.step import StepWork, directions, rotate_surface, solve, turn, workspace

UNTOUCHED = 0
SLIPPED = 1
GRASPED = 2
JAMMED = 3
STATUS_NAMES = ("untouched", "slipped", "grasped", "jammed")

TOUCH_MM = 1e-6
PENETRATION_MM = 0.004
SMALLEST_STEP = 1.0 / 256.0
MAX_STEPS = 20_000


class SqueezeWork(NamedTuple):
    """Workspace of one squeeze: contacts, LCP, placed outline and scratch vectors."""

    contacts: Contacts
    step: StepWork
    points: Array
    A: Array
    V: Array
    trial: Array
    half: Array
    no_friction: Array


def squeeze_workspace(vertices: int) -> SqueezeWork:
    """A workspace for an outline of that many vertices."""
    return SqueezeWork(
        contact.buffers(), workspace(), np.zeros((vertices, 2)), np.zeros((3, 3)), np.zeros(3), np.zeros(3),
        np.zeros(3), np.zeros(2),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def _advance(
    A: Array, rho: float, mu: Array, q: Array, top: float, bottom: float, h: float, step_top: float,
    step_bottom: float, count: int, work: SqueezeWork,
) -> int:  # fmt: skip
    """One midpoint step from pose q into `work.trial`, for contacts already found at q."""
    rotate_surface(A, q[2], work.A)
    directions(work.contacts, count, rho, 0.5 * step_top, 0.5 * step_bottom, work.step)
    status = solve(work.A, mu, work.contacts, count, work.step, work.V)
    if status != SOLVED:
        return status
    work.half[0] = q[0] + work.V[0]
    work.half[1] = q[1] + work.V[1]
    work.half[2] = q[2] + work.V[2] / rho
    half_top, half_bottom = top - 0.5 * step_top, bottom + 0.5 * step_bottom
    turn(work.contacts, count, q, work.half, half_top, half_bottom, h)
    rotate_surface(A, work.half[2], work.A)
    directions(work.contacts, count, rho, step_top, step_bottom, work.step)
    status = solve(work.A, mu, work.contacts, count, work.step, work.V)
    if status != SOLVED:
        return status
    work.trial[0] = q[0] + work.V[0]
    work.trial[1] = q[1] + work.V[1]
    work.trial[2] = q[2] + work.V[2] / rho
    return SOLVED


@njit(cache=True, nogil=True)
def _overlap(points: Array, top: float, bottom: float, h: float, thickness: float) -> float:
    """Deepest penetration of the part by either finger [mm]."""
    return max(
        contact.penetration(points, 1, top, h, thickness), contact.penetration(points, -1, bottom, h, thickness)
    )


@njit(cache=True, nogil=True)
def _held_as(
    A: Array, rho: float, q: Array, top: float, bottom: float, h: float, thickness: float, probe: float,
    work: SqueezeWork,
) -> int:  # fmt: skip
    """GRASPED where the part is blocked without friction too, else JAMMED."""
    count = contact.find(work.contacts, work.points, q, top, bottom, h, thickness, 0.5 * probe)
    rotate_surface(A, q[2], work.A)
    directions(work.contacts, count, rho, probe, probe, work.step)
    status = solve(work.A, work.no_friction, work.contacts, count, work.step, work.V)
    return JAMMED if status == SOLVED else GRASPED


@njit(cache=True, nogil=True)
def squeeze(
    outline: Array, A: Array, rho: float, mu: Array, jaws: Array, step: float, q: Array, work: SqueezeWork
) -> tuple[float, int, int]:
    """Closes the fingers on one part.

    Args:
        outline: (N, 2) counter-clockwise, in the part's frame [mm].
        A: (3, 3) limit surface matrix in the part's frame, normalised by rho.
        rho: radius of gyration of the support [mm].
        mu: (2,) friction at the upper and the lower finger.
        jaws: (4,) opening, finger length, finger thickness [mm] and the upper finger's share of the closing
            motion (0.5 = both alike).
        step: largest closing step of the opening, halved by each finger [mm].
        q: (3,) pose in the hand frame [mm, mm, rad]; modified in place into the final pose.
        work: workspace, modified in place.

    Returns:
        Final width [mm], status, and the number of steps that had to be forced (0 in a sound squeeze).
    """
    h, thickness = 0.5 * jaws[1], jaws[2]
    top_share, bottom_share = 2.0 * jaws[3], 2.0 * (1.0 - jaws[3])
    top, bottom = 0.5 * jaws[0], -0.5 * jaws[0]
    touched, forced = False, 0
    size = step
    contact.place(outline, q, work.points)
    if _overlap(work.points, top, bottom, h, thickness) > PENETRATION_MM:
        return top - bottom, JAMMED, 0
    for _ in range(MAX_STEPS):
        width = top - bottom
        free_top = contact.clearance(work.points, 1, top, h)
        free_bottom = contact.clearance(work.points, -1, bottom, h)
        free = np.inf
        if top_share > 0.0:
            free = free_top / top_share
        if bottom_share > 0.0:
            free = min(free, free_bottom / bottom_share)
        if free > 0.5 * width:
            return 0.0, SLIPPED if touched else UNTOUCHED, forced
        if free > TOUCH_MM:
            top -= top_share * free
            bottom += bottom_share * free
            continue
        touched = True
        margin = 3.0 * size + 0.05
        accepted = False
        while True:
            size = min(size, 0.5 * width)
            count = contact.find(work.contacts, work.points, q, top, bottom, h, thickness, margin)
            status = _advance(
                A, rho, mu, q, top, bottom, h, top_share * size, bottom_share * size, count, work
            )
            if status == SOLVED:
                contact.place(outline, work.trial, work.points)
                new_top, new_bottom = top - top_share * size, bottom + bottom_share * size
                if _overlap(work.points, new_top, new_bottom, h, thickness) <= PENETRATION_MM:
                    accepted = True
                    break
                contact.place(outline, q, work.points)
            if size <= step * SMALLEST_STEP:
                break
            size *= 0.25
        if not accepted:
            if status == SOLVED:
                forced += 1
            return width, _held_as(A, rho, q, top, bottom, h, thickness, 0.2, work), forced
        q[0], q[1], q[2] = work.trial[0], work.trial[1], work.trial[2]
        top, bottom = new_top, new_bottom
        if top - bottom <= TOUCH_MM:
            return 0.0, SLIPPED, forced
        size = min(2.0 * size, step)
    return top - bottom, JAMMED, forced + 1


@njit(cache=True, nogil=True)
def squeeze_many(
    outline: Array, A: Array, rho: float, mu: Array, jaws: Array, step: float, poses: Array, width: Array,
    status: IntArray, forced: IntArray, work: SqueezeWork,
) -> None:  # fmt: skip
    """`squeeze` for every row of `poses` (n, 3) with its own A (n, 3, 3) and mu (n, 2); outputs in place."""
    for i in range(poses.shape[0]):
        width[i], status[i], forced[i] = squeeze(outline, A[i], rho, mu[i], jaws, step, poses[i], work)
