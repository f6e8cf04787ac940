"""A whole squeeze: the fingers close until the part is held, or until they meet.

Free motion is skipped exactly (`clearance.free_closing`); motion in contact is stepped (`stepping.try_step`).
Where the LCP has no solution the part is held (paper, IV). It is *grasped* if no motion of the part at all
lets the fingers close further, and *jammed* if only friction prevents such a motion.
"""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inner_kernel, merged_kernel
from planner.mechanics import contacts as contact
from planner.mechanics.boundary import Boundary, Drive, directions
from planner.mechanics.clearance import Jaws, free_closing, stand
from planner.mechanics.lcp import SOLVED
from planner.mechanics.step import solve
from planner.mechanics.stepping import (
    ACCEPTED,
    HELD,
    Body,
    Scratch,
    find_contacts,
    touching,
    try_step,
)

UNTOUCHED = 0
SLIPPED = 1
GRASPED = 2
JAMMED = 3
STATUS_NAMES = ("untouched", "slipped", "grasped", "jammed")
MAX_STEPS = 20_000
HELD_GAP = 0.001
"""Gap, as a share of the part's reach, up to which contacts hold a part, despite rounding and drift."""
HELD_PROBE = 0.005
"""Trial distance of further closing, as a share of the reach."""
LARGEST_ESCAPE = 1e4
"""Motion of a frictionless part, in units of the fingers' motion, above which it counts as blocked."""


class Part(NamedTuple):
    """The part that n squeezes have in common, in its own frame."""

    outline: Array  # (2, N) counter-clockwise [mm]
    shapes: Array  # (m, 2, N) motion of the vertices for 1 mm of each deviation of the outline
    rho: float  # length that normalises rotations [mm]


class Each(NamedTuple):
    """Parameters of each of n squeezes."""

    surfaces: Array  # (n, 3, 3) ellipsoids or (n, 6, 6) quartics
    mu: Array  # (n, 2) friction at the upper and the lower finger
    share: Array  # (n,) share of the closing that the upper finger makes
    deviation: Array  # (n, m) deviations of the outline, for each shape [mm]


class RollOut(NamedTuple):
    """Results of n squeezes."""

    poses: Array  # (n, 3) final poses in the hand frame [mm, mm, rad]
    width_mm: Array  # (n,) opening at which the fingers stopped
    status: IntArray  # (n,) index into `STATUS_NAMES`
    given_up: IntArray  # (n,) 1 where the stepping failed and cut the squeeze short


@inner_kernel
def _close_freely(scratch: Scratch) -> float:
    """Closes the fingers until one touches the part; returns the mean distance that they move [mm].

    If the fingers would meet each other first, they do not move, and the result is infinite.
    """
    work, boundary = scratch.work, scratch.work.boundary
    top_share, bottom_share = boundary.top_share, boundary.bottom_share
    top, bottom = work.fingers[0], work.fingers[1]
    free = free_closing(scratch.points, top, bottom, boundary.h, top_share, bottom_share)
    if free > 0.5 * (top - bottom):
        return np.inf
    if free > 0.0:
        work.fingers[0] = top - top_share * free
        work.fingers[1] = bottom + bottom_share * free
    return float(free)


@inner_kernel
def _held_as(body: Body, q: Array, scratch: Scratch) -> int:
    """Returns `GRASPED` if the part would be blocked even without friction, else `JAMMED`.

    Without friction only the contact normals decide, so any limit surface will do. A part that could escape
    only by moving much farther than the fingers counts as blocked: otherwise rounding errors would decide for
    contacts that are exactly opposed. All lengths are relative to the part's reach, so that the result does
    not depend on its size.
    """
    find_contacts(q, HELD_GAP * body.reach, scratch)
    count, work = scratch.work.count, scratch.work.step
    for k in range(count):
        work.contacts[k].gap = 0.0
    for i in range(3):
        for j in range(3):
            work.A[i, j] = 1.0 if i == j else 0.0
    probe = HELD_PROBE * body.reach
    directions(work.contacts, count, body.rho, Drive(probe, probe, 0.0, 0.0, 0.0))
    status = solve(0.0, 0.0, count, work)
    V = work.V
    far = V[0] * V[0] + V[1] * V[1] + V[2] * V[2] > (LARGEST_ESCAPE * probe) ** 2
    return JAMMED if status == SOLVED and not far else GRASPED


@inner_kernel
def _record(trace: Array, row: int, q: Array, fingers: Array) -> int:
    """Writes pose and width into a row of the trace, or into its last row if the trace is full.

    Returns:
        The number of rows written so far, which is the index of the next row; 0 if the trace has no rows.
    """
    if trace.shape[0] == 0:
        return 0
    row = min(row, trace.shape[0] - 1)
    trace[row, 0], trace[row, 1], trace[row, 2] = q[0], q[1], q[2]
    trace[row, 3] = fingers[0] - fingers[1]
    return row + 1


@inner_kernel
def _close_by(
    boundary: Boundary, jaws: Jaws, share: float, mu_top: float, mu_bottom: float, step: float
) -> None:
    """Makes the boundary a pair of closing fingers, of which the upper one makes `share` of the closing.

    The fingers have the size of `jaws` and the friction `mu_top` and `mu_bottom`. The nominal step is `step`
    [mm].
    """
    boundary.fingers, boundary.facing, boundary.apart = 2, -1, 0.0
    boundary.h, boundary.thickness = 0.5 * jaws.length_mm, jaws.thickness_mm
    boundary.mu_top, boundary.mu_bottom, boundary.step = mu_top, mu_bottom, step
    boundary.top_share, boundary.bottom_share = 2.0 * share, 2.0 * (1.0 - share)
    boundary.x = boundary.y = boundary.turn = 0.0


@merged_kernel
def _squeeze(
    body: Body, opening: float, q: Array, scratch: Scratch, trace: Array
) -> tuple[float, int, int, int]:
    """Closes the fingers on one part at pose q (3,), which becomes the final pose.

    The poses are in the hand frame [mm, mm, rad]. The fingers start `opening` [mm] apart. `_close_by` must
    have set their size, friction, shares and step before. `trace` (rows, 4) receives poses and widths along
    the path; it may have no rows.

    Returns:
        Final width [mm], status, 1 if the squeeze was given up (else 0), number of rows of the trace written.
    """
    work, boundary = scratch.work, scratch.work.boundary
    step = boundary.step
    work.fingers[0], work.fingers[1] = 0.5 * opening, -0.5 * opening
    work.step.F[0], work.step.F[1], work.step.F[2] = 0.0, 1.0, 0.0
    work.done, work.count, work.heading[0], work.heading[1] = 0.0, 0, np.cos(q[2]), np.sin(q[2])
    touched, verdict = False, ACCEPTED
    size, margin = step, 2.0 * step + 0.05
    rows = _record(trace, 0, q, work.fingers)
    contact.place_turned(body.outline, q, work.heading[0], work.heading[1], scratch.points)
    if stand(scratch.points, work.fingers[0], work.fingers[1], boundary.h, boundary.thickness):
        return opening, JAMMED, 0, rows
    for _ in range(MAX_STEPS):
        if verdict == ACCEPTED and not touching(work):
            free = _close_freely(scratch)
            if free == np.inf:
                work.fingers[0] = work.fingers[1] = 0.5 * (work.fingers[0] + work.fingers[1])
                return (
                    0.0,
                    SLIPPED if touched else UNTOUCHED,
                    0,
                    _record(trace, rows, q, work.fingers),
                )
            rows = _record(trace, rows, q, work.fingers)
            find_contacts(q, margin, scratch)
            touched = True
        size = min(size, 0.5 * (work.fingers[0] - work.fingers[1]))
        verdict, size = try_step(body, size, margin, q, scratch)
        if verdict >= HELD:
            break
        if verdict == ACCEPTED:
            q[0], q[1], q[2] = work.trial[0], work.trial[1], work.trial[2]
            rows = _record(trace, rows, q, work.fingers)
            if work.fingers[0] - work.fingers[1] <= 1e-6:
                return 0.0, SLIPPED, 0, rows
    held = _held_as(body, q, scratch)
    return work.fingers[0] - work.fingers[1], held, 0 if verdict == HELD else 1, rows


@inner_kernel
def squeeze_many(
    part: Part,
    jaws: Jaws,
    step: float,
    each: Each,
    result: RollOut,
    scratch: Scratch,
    trace: Array,
) -> int:
    """Closes the fingers on every part of `result.poses` (n, 3), in steps of at most `step` [mm].

    `result` is filled in place. `trace` (rows, 4) receives poses and widths along the path of the last
    squeeze; it may have no rows.

    Returns:
        Number of rows of the trace that were written.
    """
    rows = 0
    for i in range(result.poses.shape[0]):
        if i == 0 or part.shapes.shape[0] > 0:
            _deviate(part, each.deviation[i], scratch.outline)
        reach = _reach(scratch.outline)
        _close_by(scratch.work.boundary, jaws, each.share[i], each.mu[i, 0], each.mu[i, 1], step)
        body = Body(scratch.outline, reach, each.surfaces[i], part.rho)
        result.width_mm[i], result.status[i], result.given_up[i], rows = _squeeze(
            body, jaws.opening_mm, result.poses[i], scratch, trace
        )
    return rows


@inner_kernel
def _reach(outline: Array) -> float:
    """Largest distance of a vertex of an outline (2, N) from the origin [mm]."""
    farthest = 0.0
    for i in range(outline.shape[1]):
        farthest = max(farthest, outline[0, i] ** 2 + outline[1, i] ** 2)
    return float(np.sqrt(farthest))


@inner_kernel
def _deviate(part: Part, deviation: Array, outline: Array) -> None:
    """Writes the outline (2, N) of a part with deviations (m,) [mm] into `outline`."""
    for j in range(2):
        for i in range(part.outline.shape[1]):
            outline[j, i] = part.outline[j, i]
            for k in range(part.shapes.shape[0]):
                outline[j, i] += deviation[k] * part.shapes[k, j, i]
