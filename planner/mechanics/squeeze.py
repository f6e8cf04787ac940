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
    RAY,
    SOLVED,
    StepWork,
    directions,
    event_fraction,
    solve,
    turn,
    workspace,
)
from planner.mechanics.surface_step import solve_surface

UNTOUCHED = 0
SLIPPED = 1
GRASPED = 2
JAMMED = 3
STATUS_NAMES = ("untouched", "slipped", "grasped", "jammed")

PENETRATION_MM = 0.01
"""Overlap at which a step is refused."""
LARGEST_TURN = 0.1
"""Largest rotation in one step [rad]."""
EULER_ERROR = 0.03
"""Largest difference between Euler and midpoint step, as a share of the nominal step."""
SMALLEST_STEP = 1.0 / 256.0
MAX_STEPS = 20_000
WIDEN = 2
"""Vertices kept placed on either side of one near a finger."""
NEAR_MM = 3.0
"""How far around the fingers vertices are followed between two looks at the whole outline."""


class SqueezeWork(NamedTuple):
    """Workspace of one squeeze.

    Attributes:
        C, I: contact buffers.
        step: workspace of the step.
        points: (N, 2) the outline, placed.
        placed: (N,) vertices kept placed.
        near: (N,) vertices near the fingers.
        listed: (3,) how many are placed, how many near, and how many contacts were found.
        A: (3, 3) the ellipsoid, or the quartic's local one, in the hand frame.
        local: (3, 3) the same in the part's frame.
        F: (3,) unit wrench of the last step, in the part's frame.
        V: (3,) displacement.
        trial: (3,) pose after the step.
        half: (3,) pose in its middle.
        fingers: (2,) y of the inner faces, upper and lower.
    """

    C: Array
    I: IntArray
    step: StepWork
    points: Array
    placed: IntArray
    near: IntArray
    listed: IntArray
    A: Array
    local: Array
    F: Array
    V: Array
    trial: Array
    half: Array
    fingers: Array


PLACED, NEAR, FOUND = 0, 1, 2
ACCEPTED, RETRY, HELD, GIVEN_UP = 0, 1, 2, 3


def squeeze_workspace(vertices: int) -> SqueezeWork:
    """A workspace for an outline of that many vertices."""
    return SqueezeWork(
        C=np.zeros((MAX_CONTACTS, C_COLUMNS)),
        I=np.zeros((MAX_CONTACTS, I_COLUMNS), np.int64),
        step=workspace(),
        points=np.zeros((vertices, 2)),
        placed=np.zeros(vertices, np.int64),
        near=np.zeros(vertices, np.int64),
        listed=np.zeros(3, np.int64),
        A=np.zeros((3, 3)),
        local=np.zeros((3, 3)),
        F=np.array([0.0, 1.0, 0.0]),
        V=np.zeros(3),
        trial=np.zeros(3),
        half=np.zeros(3),
        fingers=np.zeros(2),
    )


@kernel
def _midpoint(
    surface: Array, rho: float, mu_top: float, mu_bottom: float, q: Array, h: float, step_top: float,
    step_bottom: float, work: SqueezeWork,
) -> tuple[int, float]:  # fmt: skip
    """One midpoint step from pose q into `work.trial`, for contacts already found at q.

    Returns the status and the difference between the Euler and the midpoint step [mm]; -1 where there is no
    Euler step.
    """
    C, I, V, count = work.C, work.I, work.V, work.listed[FOUND]
    directions(C, I, count, rho, step_top, step_bottom)
    status = solve_surface(
        surface, q[2], mu_top, mu_bottom, C, I, count, work.step, work.A, work.local, work.F, V
    )
    if status != SOLVED:
        return status, -1.0
    v0, v1, v2 = V[0], V[1], V[2]
    work.half[0] = q[0] + 0.5 * v0
    work.half[1] = q[1] + 0.5 * v1
    work.half[2] = q[2] + 0.5 * v2 / rho
    top, bottom = work.fingers[0] - 0.5 * step_top, work.fingers[1] + 0.5 * step_bottom
    turn(C, I, count, q, work.half, top, bottom, h)
    directions(C, I, count, rho, step_top, step_bottom)
    status = solve_surface(
        surface, work.half[2], mu_top, mu_bottom, C, I, count, work.step, work.A, work.local, work.F, V
    )
    if status != SOLVED:
        return status, 0.0
    work.trial[0] = q[0] + V[0]
    work.trial[1] = q[1] + V[1]
    work.trial[2] = q[2] + V[2] / rho
    return SOLVED, np.sqrt((V[0] - v0) ** 2 + (V[1] - v1) ** 2 + (V[2] - v2) ** 2)


@kernel
def _list_near(work: SqueezeWork) -> None:
    """Lists the vertices near the fingers' faces, and those with their neighbours."""
    points, near, placed = work.points, work.near, work.placed
    n = points.shape[0]
    near_count, placed_count = 0, 0
    high, low = work.fingers[0] - NEAR_MM, work.fingers[1] + NEAR_MM
    last = -1 - WIDEN  # the latest vertex near a finger, of those up to WIDEN ahead
    for ahead in range(-WIDEN, WIDEN):
        y = points[ahead % n, 1]
        if y > high or y < low:
            last = ahead
    for i in range(n):
        y = points[(i + WIDEN) % n, 1]
        if y > high or y < low:
            last = i + WIDEN
        if last >= i - WIDEN:
            placed[placed_count] = i
            placed_count += 1
        j = i + 1 if i + 1 < n else 0
        if points[i, 1] > high or points[i, 1] < low or points[j, 1] > high or points[j, 1] < low:
            near[near_count] = i
            near_count += 1
    work.listed[NEAR], work.listed[PLACED] = near_count, placed_count


@kernel
def _close_freely(
    outline: Array, q: Array, h: float, top_share: float, bottom_share: float, work: SqueezeWork
) -> bool:
    """Places the whole outline and closes the fingers up to the first touch; False where there is none."""
    n = outline.shape[0]
    for i in range(n):
        work.placed[i] = i
    contact.place(outline, q, work.points, work.placed, n)
    top, bottom = work.fingers[0], work.fingers[1]
    free = np.inf
    if top_share > 0.0:
        free = contact.clearance(work.points, 1, top, h) / top_share
    if bottom_share > 0.0:
        free = min(free, contact.clearance(work.points, -1, bottom, h) / bottom_share)
    if free > 0.5 * (top - bottom):
        return False
    if free > 0.0:
        work.fingers[0] = top - top_share * free
        work.fingers[1] = bottom + bottom_share * free
    return True


@kernel
def _blocked(outline: Array, q: Array, h: float, thickness: float, work: SqueezeWork) -> bool:
    """Whether the open fingers would stand on the part."""
    for i in range(outline.shape[0]):
        work.placed[i] = i
    contact.place(outline, q, work.points, work.placed, outline.shape[0])
    top, bottom = work.fingers[0], work.fingers[1]
    return contact.blocked(work.points, 1, top, h, thickness) or contact.blocked(
        work.points, -1, bottom, h, thickness
    )


@kernel
def _find(q: Array, h: float, thickness: float, margin: float, work: SqueezeWork) -> None:
    """Finds the contacts among the near vertices."""
    work.listed[FOUND] = contact.find(
        work.C, work.I, work.points, work.near, work.listed[NEAR], q, work.fingers[0], work.fingers[1], h,
        thickness, margin,
    )  # fmt: skip


@kernel
def _overlap(h: float, thickness: float, work: SqueezeWork) -> float:
    """Deepest overlap among the contacts found and the near vertices [mm]."""
    deepest = 0.0
    for k in range(work.listed[FOUND]):
        deepest = max(deepest, -work.C[k, GAP])
    for m in range(work.listed[NEAR]):
        x, y = work.points[work.near[m], 0], work.points[work.near[m], 1]
        behind = y - work.fingers[0] if y > 0.5 * (work.fingers[0] + work.fingers[1]) else work.fingers[1] - y
        deepest = max(deepest, min(behind, h - abs(x), thickness - behind))
    return deepest


@kernel
def _try_step(
    outline: Array, surface: Array, rho: float, mu_top: float, mu_bottom: float, jaws: Array, step: float,
    size: float, margin: float, q: Array, work: SqueezeWork,
) -> tuple[int, float]:  # fmt: skip
    """Tries a step of the given size; returns what came of it and the size to go on with.

    An accepted step leaves the new pose in `work.trial`, the fingers advanced, and the contacts found there.
    """
    h, thickness = 0.5 * jaws[1], jaws[2]
    step_top, step_bottom = 2.0 * jaws[3] * size, 2.0 * (1.0 - jaws[3]) * size
    smallest = size <= step * SMALLEST_STEP
    status, error = _midpoint(surface, rho, mu_top, mu_bottom, q, h, step_top, step_bottom, work)
    if status != SOLVED:
        if error < 0.0 or smallest:
            return (HELD if status == RAY else GIVEN_UP), size
        return RETRY, 0.25 * size
    turned = abs(work.trial[2] - q[2])
    allowed = EULER_ERROR * step
    if (error > allowed or turned > LARGEST_TURN) and not smallest:
        return RETRY, size * max(
            0.2, min(0.8 * np.sqrt(allowed / (error + 1e-12)), 0.8 * LARGEST_TURN / turned)
        )
    fraction = event_fraction(work.C, work.listed[FOUND], work.V)
    if fraction < 0.95 and not smallest:
        return RETRY, size * max(fraction, SMALLEST_STEP)
    contact.place(outline, work.trial, work.points, work.placed, work.listed[PLACED])
    work.fingers[0] -= step_top
    work.fingers[1] += step_bottom
    _find(work.trial, h, thickness, margin, work)
    if _overlap(h, thickness, work) > PENETRATION_MM:
        contact.place(outline, q, work.points, work.placed, work.listed[PLACED])
        work.fingers[0] += step_top
        work.fingers[1] -= step_bottom
        return (GIVEN_UP if smallest else RETRY), 0.25 * size
    return ACCEPTED, min(step, size * min(2.0, 0.8 * np.sqrt(allowed / (error + 1e-12))))


@kernel
def _held_as(rho: float, q: Array, h: float, thickness: float, work: SqueezeWork) -> int:
    """GRASPED where the part is blocked without friction too, else JAMMED.

    Without friction only the contact normals decide, so any limit surface will do.
    """
    _find(q, h, thickness, 0.02, work)
    count = work.listed[FOUND]
    for k in range(count):
        work.C[k, GAP] = 0.0
    for i in range(3):
        for j in range(3):
            work.A[i, j] = 1.0 if i == j else 0.0
    directions(work.C, work.I, count, rho, 0.1, 0.1)
    status = solve(work.A, 0.0, 0.0, work.C, work.I, count, work.step, work.V)
    return JAMMED if status == SOLVED else GRASPED


@kernel
def _record(trace: Array, row: int, q: Array, fingers: Array) -> int:
    """Writes pose and width into the trace, the last row again where it is full; returns the next row."""
    if trace.shape[0] == 0:
        return 0
    row = min(row, trace.shape[0] - 1)
    trace[row, 0], trace[row, 1], trace[row, 2] = q[0], q[1], q[2]
    trace[row, 3] = fingers[0] - fingers[1]
    return row + 1


@kernel
def squeeze(
    outline: Array, reach: float, surface: Array, rho: float, mu_top: float, mu_bottom: float, jaws: Array,
    step: float, q: Array, work: SqueezeWork, trace: Array,
) -> tuple[float, int, int, int]:  # fmt: skip
    """Closes the fingers on one part.

    Args:
        outline: (N, 2) counter-clockwise, in the part's frame [mm].
        reach: largest distance of a vertex from the part's origin [mm].
        surface: (3, 3) the ellipsoid's matrix or (6, 6) the quartic's table, in the part's frame.
        rho: length that normalises rotations [mm].
        mu_top: friction at the upper finger.
        mu_bottom: friction at the lower finger.
        jaws: (4,) opening, finger length, finger thickness [mm] and the upper finger's share of the closing
            motion (0.5 = both alike).
        step: nominal closing step of each finger [mm].
        q: (3,) pose in the hand frame [mm, mm, rad]; modified in place into the final pose.
        work: workspace, modified in place.
        trace: (rows, 4) receives poses and widths on the way; no rows for none.

    Returns:
        Final width [mm], status, 1 where the squeeze had to be given up (else 0), rows of the trace.
    """
    h, thickness = 0.5 * jaws[1], jaws[2]
    top_share, bottom_share = 2.0 * jaws[3], 2.0 * (1.0 - jaws[3])
    work.fingers[0], work.fingers[1] = 0.5 * jaws[0], -0.5 * jaws[0]
    work.F[0], work.F[1], work.F[2] = 0.0, 1.0, 0.0
    touched, verdict = False, ACCEPTED
    budget, size, margin = 0.0, step, 2.0 * step + 0.05
    rows = _record(trace, 0, q, work.fingers)
    if _blocked(outline, q, h, thickness, work):
        return jaws[0], JAMMED, 0, rows
    for _ in range(MAX_STEPS):
        if verdict == ACCEPTED and budget < margin:
            found = _close_freely(outline, q, h, top_share, bottom_share, work)
            if not found:
                work.fingers[0] = work.fingers[1] = 0.5 * (work.fingers[0] + work.fingers[1])
                return 0.0, SLIPPED if touched else UNTOUCHED, 0, _record(trace, rows, q, work.fingers)
            touched = True
            rows = _record(trace, rows, q, work.fingers)
            _list_near(work)
            _find(q, h, thickness, margin, work)
            budget = NEAR_MM
        elif verdict == RETRY:
            _find(q, h, thickness, margin, work)
        if work.listed[FOUND] == 0 and budget < NEAR_MM:
            budget = 0.0
            continue
        size = min(size, 0.5 * (work.fingers[0] - work.fingers[1]))
        top = work.fingers[0]
        verdict, size = _try_step(outline, surface, rho, mu_top, mu_bottom, jaws, step, size, margin, q, work)
        if verdict >= HELD:
            break
        if verdict == ACCEPTED:
            dx, dy, turned = work.trial[0] - q[0], work.trial[1] - q[1], abs(work.trial[2] - q[2])
            budget -= np.sqrt(dx * dx + dy * dy) + turned * reach + 2.0 * (top - work.fingers[0])
            q[0], q[1], q[2] = work.trial[0], work.trial[1], work.trial[2]
            rows = _record(trace, rows, q, work.fingers)
            if work.fingers[0] - work.fingers[1] <= 1e-6:
                return 0.0, SLIPPED, 0, rows
    held = _held_as(rho, q, h, thickness, work)
    return work.fingers[0] - work.fingers[1], held, 0 if verdict == HELD else 1, rows


@kernel
def squeeze_many(
    outline: Array, surfaces: Array, rho: float, mu: Array, jaws: Array, step: float, poses: Array,
    width: Array, status: IntArray, given_up: IntArray, work: SqueezeWork,
) -> None:  # fmt: skip
    """`squeeze` for every row of `poses` (n, 3) with its own surface and mu (n, 2); outputs in place."""
    reach = 0.0
    for i in range(outline.shape[0]):
        reach = max(reach, np.sqrt(outline[i, 0] ** 2 + outline[i, 1] ** 2))
    trace = np.zeros((0, 4))
    for i in range(poses.shape[0]):
        width[i], status[i], given_up[i], _ = squeeze(
            outline, reach, surfaces[i], rho, mu[i, 0], mu[i, 1], jaws, step, poses[i], work, trace
        )
