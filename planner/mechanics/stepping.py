"""One accepted, retried or refused step of a squeeze: the midpoint rule with error control and events.

The difference between the midpoint and the explicit Euler step controls the length of a step; it ends where
an awaited contact touches or a pressed one leaves its feature, by the rule's dense output, and is refused
where the part would overlap a finger.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inlined_kernel, inner_kernel
from planner.mechanics import contacts as contact
from planner.mechanics.clearance import crosses
from planner.mechanics.contacts import (
    FINGER,
    GAP,
    MAX_CONTACTS,
    NY,
)
from planner.mechanics.lcp import RAY, SOLVED
from planner.mechanics.step import STEP_WORK, TOUCHING_MM, along, directions, event_fraction, turn
from planner.mechanics.surface_step import solve_surface

PENETRATION_MM = 0.01  # Overlap at which a step is refused
LARGEST_TURN = 0.1  # Largest rotation in one step [rad]
EULER_ERROR = 0.02  # Largest difference between Euler and midpoint step, as a share of the nominal step
SMALLEST_STEP = 2.0**-18
"""Shortest step, as a share of the nominal one: a part at an unstable equilibrium turns that much faster."""
LEAST_FACING = 0.1  # Sine of the least angle to the closing direction, of a face that stops a finger
FURTHEST = 2.0  # How much nearer part and fingers may come in one step, in margins


SQUEEZE_WORK = np.dtype(
    [
        ("before", np.float64, (MAX_CONTACTS, NY + 1)),
        ("step", STEP_WORK),
        ("found", np.int64),
        ("heading", np.float64, 2),
        ("trial", np.float64, 3),
        ("half", np.float64, 3),
        ("euler", np.float64, 3),
        ("fingers", np.float64, 2),
    ],
    align=True,
)
"""Workspace of one squeeze.

before: places and normals of the contacts before the midpoint's turn. step: the contacts, and the solution.
found: how many contacts were found. heading: cosine and sine of the part's angle. trial, half: pose after
the step and in its middle. euler: the displacement V of the explicit Euler step. fingers: y of the inner
faces.
"""
SqueezeWork: TypeAlias = Any

ACCEPTED, RETRY, HELD, GIVEN_UP = range(4)
"""What came of a step: taken; to be tried again, shorter; no solution; neither."""


def squeeze_workspace() -> SqueezeWork:
    """A fresh workspace: a record of `SQUEEZE_WORK`."""
    return np.zeros(1, SQUEEZE_WORK).view(np.recarray)[0]


class Body(NamedTuple):
    """A part, in its own frame."""

    outline: Array  # (2, N) counter-clockwise [mm]
    reach: float  # largest distance of a vertex from the part's origin [mm]
    surface: Array  # (3, 3) the ellipsoid's matrix or (6, 6) the quartic's table
    rho: float  # length that normalises rotations [mm]


class Grip(NamedTuple):
    """How the fingers close."""

    mu_top: float  # friction at the upper finger
    mu_bottom: float  # friction at the lower finger
    opening: float  # of the jaws [mm]
    h: float  # half the finger's length [mm]
    thickness: float  # of a finger [mm]
    top_share: float  # motion of the upper finger for each millimetre of the mean finger's; 1 = both alike
    bottom_share: float  # of the lower one; both together are 2
    step: float  # nominal closing step of a finger [mm]


class Scratch(NamedTuple):
    """Workspaces of a squeeze, modified in place."""

    points: Array  # (2, N) the placed outline
    out: IntArray  # (N,) which vertices are far from the fingers, as `contacts.mark` says
    work: SqueezeWork  # a record of `SQUEEZE_WORK`


@inlined_kernel
def _turn_back(work: SqueezeWork) -> None:
    """Undoes what `_midpoint` did to the contacts."""
    for k in range(work.found):
        for column in range(NY + 1):
            work.step.C[k, column] = work.before[k, column]


@inner_kernel
def _midpoint(
    body: Body, grip: Grip, q: Array, step_top: float, step_bottom: float, work: SqueezeWork
) -> tuple[int, float]:
    """One midpoint step from pose q, for contacts already found there, into `work.euler` and `work.step.V`.

    Returns the status and the difference between the Euler and the midpoint step [mm], or -1.
    """
    C, I, V, first, count = work.step.C, work.step.I, work.step.V, work.euler, work.found
    surface, rho, mu_top, mu_bottom = body.surface, body.rho, grip.mu_top, grip.mu_bottom
    for k in range(count):
        for column in range(NY + 1):
            work.before[k, column] = C[k, column]
    directions(C, I, count, rho, step_top, step_bottom)
    c, s = work.heading[0], work.heading[1]
    status = solve_surface(surface, c, s, mu_top, mu_bottom, count, work.step)
    if status != SOLVED:
        return status, -1.0
    first[0], first[1], first[2] = V[0], V[1], V[2]
    work.half[0] = q[0] + 0.5 * V[0]
    work.half[1] = q[1] + 0.5 * V[1]
    work.half[2] = q[2] + 0.5 * V[2] / rho
    turned = work.half[2] - q[2]
    dc, ds = np.cos(turned), np.sin(turned)
    top, bottom = work.fingers[0] - 0.5 * step_top, work.fingers[1] + 0.5 * step_bottom
    turn(C, I, count, dc, ds, work.half, top, bottom, grip.h, grip.thickness)
    directions(C, I, count, rho, step_top, step_bottom)
    c, s = dc * c - ds * s, dc * s + ds * c
    status = solve_surface(surface, c, s, mu_top, mu_bottom, count, work.step)
    if status != SOLVED:
        return status, 0.0
    return SOLVED, np.sqrt((V[0] - first[0]) ** 2 + (V[1] - first[1]) ** 2 + (V[2] - first[2]) ** 2)


@inner_kernel
def find_contacts(q: Array, grip: Grip, margin: float, scratch: Scratch) -> None:
    """Finds the contacts of a part placed at pose q (3,), gaps of at most `margin` [mm]."""
    work = scratch.work
    work.found = contact.find(
        work.step.C, work.step.I, scratch.points, scratch.out, q, work.fingers[0], work.fingers[1],
        grip.h, grip.thickness, margin,
    )  # fmt: skip


@inlined_kernel
def touching(work: SqueezeWork) -> bool:
    """Whether a found contact keeps a finger from closing any further without moving the part."""
    C, I = work.step.C, work.step.I
    for k in range(work.found):
        if C[k, GAP] <= TOUCHING_MM and I[k, FINGER] * C[k, NY] < -LEAST_FACING:
            return True
    return False


@inner_kernel
def _overlaps(grip: Grip, scratch: Scratch) -> bool:
    """Whether a contact overlaps by more than `PENETRATION_MM`, or a near edge runs that deep in a finger."""
    points, out, work = scratch.points, scratch.out, scratch.work
    h, thickness = grip.h, grip.thickness
    for k in range(work.found):
        if work.step.C[k, GAP] < -PENETRATION_MM:
            return True
    n = points.shape[1]
    half_x, half_y = h - PENETRATION_MM, 0.5 * thickness - PENETRATION_MM
    above, below = work.fingers[0] + PENETRATION_MM, work.fingers[1] - PENETRATION_MM
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if out[i] & out[j]:
            continue
        x0, x1, y0, y1 = points[0, i], points[0, j], points[1, i], points[1, j]
        if (x0 > half_x and x1 > half_x) or (x0 < -half_x and x1 < -half_x):
            continue
        if y0 > above or y1 > above:
            middle = work.fingers[0] + 0.5 * thickness
            if crosses(x0, y0 - middle, x1, y1 - middle, half_x, half_y):
                return True
        if y0 < below or y1 < below:
            middle = work.fingers[1] - 0.5 * thickness
            if crosses(x0, y0 - middle, x1, y1 - middle, half_x, half_y):
                return True
    return False


@inlined_kernel
def approach(body: Body, q: Array, trial: Array, step_top: float, step_bottom: float) -> float:
    """How much nearer any vertex may have come to a finger along x or y [mm]: part from q to `trial`."""
    dx, dy = trial[0] - q[0], trial[1] - q[1]
    return float(max(abs(dx), step_top + dy, step_bottom - dy) + abs(trial[2] - q[2]) * body.reach)


@inner_kernel
def try_step(
    body: Body, grip: Grip, size: float, margin: float, q: Array, scratch: Scratch
) -> tuple[int, float]:
    """Tries a closing step of `size` [mm] from pose q (3,); returns what came of it and the next size.

    The scratch holds the contacts at q, and those again where the step is to be retried. An accepted step
    ends at its first event, if it has one; it leaves the new pose in `work.trial`, the fingers advanced, and
    the contacts found there, with gaps of at most `margin` [mm].
    """
    step, work = grip.step, scratch.work
    step_top, step_bottom = grip.top_share * size, grip.bottom_share * size
    smallest = size <= step * SMALLEST_STEP
    status, error = _midpoint(body, grip, q, step_top, step_bottom, work)
    if status != SOLVED:
        if error < 0.0 or smallest:
            return (HELD if status == RAY else GIVEN_UP), size
        _turn_back(work)
        return RETRY, 0.25 * size
    first, V = work.euler, work.step.V
    f = max(event_fraction(work.step.C, work.found, first, V), SMALLEST_STEP)
    for i in range(3):
        moved = along(first, V, f, i)
        work.trial[i] = q[i] + (moved / body.rho if i == 2 else moved)
    step_top, step_bottom = f * step_top, f * step_bottom
    turned, allowed = abs(work.trial[2] - q[2]), EULER_ERROR * step
    longer = 0.8 * np.sqrt(allowed / (error + 1e-12))
    if (f * f * error > allowed or turned > LARGEST_TURN) and not smallest:
        _turn_back(work)
        return RETRY, f * size * max(0.2, min(longer / f, 0.8 * LARGEST_TURN / (turned + 1e-12)))
    if approach(body, q, work.trial, step_top, step_bottom) > FURTHEST * margin and not smallest:
        _turn_back(work)
        return RETRY, 0.5 * f * size
    c, s = np.cos(work.trial[2]), np.sin(work.trial[2])
    contact.place_turned(body.outline, work.trial, c, s, scratch.points)
    work.fingers[0] -= step_top
    work.fingers[1] += step_bottom
    find_contacts(work.trial, grip, margin, scratch)
    if _overlaps(grip, scratch):
        contact.place_turned(body.outline, q, work.heading[0], work.heading[1], scratch.points)
        work.fingers[0] += step_top
        work.fingers[1] -= step_bottom
        find_contacts(q, grip, margin, scratch)
        return (GIVEN_UP if smallest else RETRY), 0.25 * f * size
    work.heading[0], work.heading[1] = c, s
    return ACCEPTED, min(step, size * min(2.0, longer))
