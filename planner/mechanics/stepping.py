"""One step of a squeeze or a push: midpoint rule, error control and events.

The difference between the midpoint and the explicit Euler step controls the length of a step. A step ends
early where an open contact touches, or where a pressed contact slides off its feature; the dense output of
the midpoint rule tells where. A step is refused where the part would overlap a finger.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inlined_kernel, inner_kernel, merged_kernel
from planner.mechanics import contacts as contact
from planner.mechanics.boundary import (
    BOUNDARY,
    Drive,
    directions,
    drive_of,
    hand_of,
    subtract_carriage,
    turn,
)
from planner.mechanics.clearance import crosses
from planner.mechanics.contacts import CONTACT, MAX_CONTACTS, PENETRATION_MM, Contact
from planner.mechanics.lcp import RAY, SOLVED
from planner.mechanics.step import STEP_WORK, TOUCHING_MM, along, event_fraction
from planner.mechanics.surface_step import solve_surface

LARGEST_TURN = 0.1  # Largest rotation in one step [rad]
EULER_ERROR = 0.02  # Largest difference of Euler and midpoint step, as a share of the nominal step
SMALLEST_STEP = 2.0**-18
"""Shortest step, as a share of the nominal step: near an unstable equilibrium a part turns very fast."""
LEAST_FACING = 0.1  # Sine of the least angle from closing direction to a face that stops a finger
FURTHEST = (
    2.0  # Largest approach of part and fingers in one step, in units of the margin of `try_step`
)


SQUEEZE_WORK = np.dtype(
    [
        ("boundary", BOUNDARY),
        ("before", CONTACT, MAX_CONTACTS),
        ("step", STEP_WORK),
        ("count", np.int64),
        ("heading", np.float64, 2),
        ("trial", np.float64, 3),
        ("half", np.float64, 3),
        ("euler", np.float64, 3),
        ("fingers", np.float64, 2),
        ("done", np.float64),
        ("moved", np.int64),
    ],
    align=True,
)
"""Workspace of one squeeze or push.

boundary: the boundary that moves against the part. before: places and normals that the contacts had before
the midpoint rule turned them. step: the contacts, and the solution of a step. count: number of contacts.
heading: cosine and sine of the part's angle. trial: pose after the step. half: pose in the middle of the
step. euler: displacement V of the explicit Euler step. fingers: y of the inner faces [mm]. done: distance
that the boundary has moved [mm]. moved: 1 once a push has moved the part on the table.
"""
SqueezeWork: TypeAlias = Any

ACCEPTED, RETRY, HELD, GIVEN_UP = range(4)
"""Results of `try_step`: step taken; to be retried, shorter; no solution (part held); numerical failure."""


class Body(NamedTuple):
    """A part, in its own frame."""

    outline: Array  # (2, N) counter-clockwise [mm]
    reach: float  # largest distance of a vertex from the part's origin [mm]
    surface: Array  # (3, 3) the ellipsoid's matrix or (6, 6) the quartic's table
    rho: float  # length that normalises rotations [mm]


class Scratch(NamedTuple):
    """Workspaces of squeezes or pushes, modified in place."""

    outline: Array  # (2, N) of the part, in its own frame
    points: Array  # (2, N) the placed outline
    out: IntArray  # (N,) outcodes of the vertices, see `contacts.mark`
    work: SqueezeWork  # a record of `SQUEEZE_WORK`


def scratch_of(outline: Array) -> Scratch:
    """Fresh workspaces for a part's outline (N, 2)."""
    n = len(outline)
    work = np.zeros(1, SQUEEZE_WORK).view(np.recarray)[0]
    columns = np.array(outline.T, order="C")
    return Scratch(columns, np.zeros((2, n)), np.zeros(n, np.int64), work)


@inlined_kernel
def _copy_place(source: Contact, target: Contact) -> None:
    """Copies place and normal from one record to another."""
    target.x, target.y, target.nx, target.ny = source.x, source.y, source.nx, source.ny


@inlined_kernel
def _turn_back(work: SqueezeWork) -> None:
    """Restores the places and normals that the contacts had before `_midpoint`."""
    for k in range(work.count):
        _copy_place(work.before[k], work.step.contacts[k])


@merged_kernel
def _displacement(body: Body, drive: Drive, c: float, s: float, work: SqueezeWork) -> int:
    """Solves one step for a part turned by an angle of cosine c and sine s; returns a status (`step.solve`).

    `work.step.V` receives the part's displacement in the boundary's frame.
    """
    contacts, V, count, boundary = work.step.contacts, work.step.V, work.count, work.boundary
    directions(contacts, count, body.rho, drive)
    status = solve_surface(
        body.surface, c, s, boundary.mu_top, boundary.mu_bottom, count, work.step
    )
    if status == SOLVED and (drive.x != 0.0 or drive.y != 0.0 or drive.turn != 0.0):
        work.moved |= V[0] != 0.0 or V[1] != 0.0 or V[2] != 0.0
        subtract_carriage(contacts, count, body.rho, drive, V)
    return status


@merged_kernel
def _midpoint(body: Body, q: Array, size: float, work: SqueezeWork) -> tuple[int, float]:
    """Computes a step of `size` [mm] from pose q (3,), whose contacts `work` holds, by the midpoint rule.

    `work.euler` and `work.step.V` receive the displacements of the Euler and of the midpoint step.

    Returns:
        A status (`step.solve`), and the difference between the two displacements [mm]. The difference is -1
        if the Euler step has no solution, and 0 if only the midpoint step has none.
    """
    contacts, V, first, count = work.step.contacts, work.step.V, work.euler, work.count
    for k in range(count):
        _copy_place(contacts[k], work.before[k])
    drive = drive_of(work.boundary, size, work.done, q)
    c, s = work.heading[0], work.heading[1]
    status = _displacement(body, drive, c, s, work)
    if status != SOLVED:
        return status, -1.0
    first[0], first[1], first[2] = V[0], V[1], V[2]
    work.half[0] = q[0] + 0.5 * V[0]
    work.half[1] = q[1] + 0.5 * V[1]
    work.half[2] = q[2] + 0.5 * V[2] / body.rho
    turned = work.half[2] - q[2]
    dc, ds = np.cos(turned), np.sin(turned)
    turn(contacts, count, (dc, ds), q, work.half, drive, work.boundary.radius)
    drive = drive_of(work.boundary, size, work.done + 0.5 * size, work.half)
    status = _displacement(body, drive, dc * c - ds * s, dc * s + ds * c, work)
    if status != SOLVED:
        return status, 0.0
    return SOLVED, np.sqrt((V[0] - first[0]) ** 2 + (V[1] - first[1]) ** 2 + (V[2] - first[2]) ** 2)


@inner_kernel
def find_contacts(q: Array, margin: float, scratch: Scratch) -> None:
    """Finds the contacts of the part at pose q (3,), whose outline at this pose is `scratch.points`.

    Writes all contacts with gaps of at most `margin` [mm] into `scratch.work`.
    """
    work = scratch.work
    contacts, points, boundary = work.step.contacts, scratch.points, work.boundary
    if boundary.fingers > 0:
        hand = hand_of(boundary, work.fingers)
        work.count = contact.find(contacts, points, scratch.out, q, hand, margin)
    else:
        pusher = contact.Tips(boundary.pusher[: boundary.points], boundary.radius)
        work.count = contact.find_points(contacts, points, q, pusher, margin)


@inlined_kernel
def touching(work: SqueezeWork) -> bool:
    """Whether some contact stops a finger, which then cannot close further without moving the part."""
    for k in range(work.count):
        each = work.step.contacts[k]
        if each.gap <= TOUCHING_MM and each.finger * each.ny < -LEAST_FACING:
            return True
    return False


@inlined_kernel
def _runs_into(finger: contact.Finger, points: Array, i: int, j: int) -> bool:
    """Whether the edge from vertex i to j runs deeper than `PENETRATION_MM` into the finger."""
    half_x, half_y = finger.h - PENETRATION_MM, 0.5 * finger.thickness - PENETRATION_MM
    x0, x1 = points[0, i] - finger.centre, points[0, j] - finger.centre
    if (x0 > half_x and x1 > half_x) or (x0 < -half_x and x1 < -half_x):
        return False
    y0, y1 = points[1, i] - finger.face, points[1, j] - finger.face
    if finger.side * y0 <= PENETRATION_MM and finger.side * y1 <= PENETRATION_MM:
        return False
    middle = 0.5 * finger.side * finger.thickness
    return crosses(x0, y0 - middle, x1, y1 - middle, half_x, half_y)


@inner_kernel
def _overlaps(scratch: Scratch) -> bool:
    """Whether a contact overlaps by more than `PENETRATION_MM`, or an edge runs that deep into a finger."""
    points, out, work = scratch.points, scratch.out, scratch.work
    for k in range(work.count):
        if work.step.contacts[k].gap < -PENETRATION_MM:
            return True
    hand = hand_of(work.boundary, work.fingers)
    n = points.shape[1] if hand.fingers > 0 else 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        if out[i] & out[j]:
            continue
        if _runs_into(hand.first, points, i, j) or (
            hand.fingers == 2 and _runs_into(hand.second, points, i, j)
        ):
            return True
    return False


@inlined_kernel
def approach(body: Body, q: Array, trial: Array, step_top: float, step_bottom: float) -> float:
    """Upper bound on how much nearer any vertex comes to a finger along x or y, from pose q to `trial` [mm].

    `step_top` and `step_bottom` are the motions of the fingers [mm].
    """
    dx, dy = trial[0] - q[0], trial[1] - q[1]
    return float(max(abs(dx), step_top + dy, step_bottom - dy) + abs(trial[2] - q[2]) * body.reach)


@merged_kernel
def try_step(
    body: Body, size: float, margin: float, q: Array, scratch: Scratch
) -> tuple[int, float]:
    """Tries a step of `size` [mm] from pose q (3,), and accepts it or proposes another size.

    `scratch` holds the contacts at q, and still does so if the step is to be retried. An accepted step ends
    at its first event, if any. It leaves the new pose in `work.trial`, the boundary advanced, and the
    contacts at the new pose, with gaps of at most `margin` [mm].

    Returns:
        `ACCEPTED`, `RETRY`, `HELD` or `GIVEN_UP`; and the size of the next step [mm].
    """
    work, boundary = scratch.work, scratch.work.boundary
    step = boundary.step
    smallest = size <= step * SMALLEST_STEP
    status, error = _midpoint(body, q, size, work)
    if status != SOLVED:
        if error < 0.0 or smallest:
            return (HELD if status == RAY else GIVEN_UP), size
        _turn_back(work)
        return RETRY, 0.25 * size
    first, V = work.euler, work.step.V
    f = max(event_fraction(work.step.contacts, work.count, first, V), SMALLEST_STEP)
    for i in range(3):
        moved = along(first, V, f, i)
        work.trial[i] = q[i] + (moved / body.rho if i == 2 else moved)
    step_top, step_bottom = f * size * boundary.top_share, f * size * boundary.bottom_share
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
    find_contacts(work.trial, margin, scratch)
    if _overlaps(scratch):
        contact.place_turned(body.outline, q, work.heading[0], work.heading[1], scratch.points)
        work.fingers[0] += step_top
        work.fingers[1] -= step_bottom
        find_contacts(q, margin, scratch)
        return (GIVEN_UP if smallest else RETRY), 0.25 * f * size
    work.heading[0], work.heading[1], work.done = c, s, work.done + f * size
    return ACCEPTED, min(step, size * min(2.0, longer))
