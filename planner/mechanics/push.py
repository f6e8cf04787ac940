"""A push: a rigid pusher follows a commanded path, and the part yields.

The pusher is a set of points, or the fingers of a hand that moves straight ahead. The part is simulated in
the frame of the pusher, by the same steps as in a squeeze (`stepping.try_step`). The part never jams. Where
friction wedges it between two places of the pusher, the LCP has no solution, and the part moves along with
the pusher.
"""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inner_kernel, merged_kernel
from planner.mechanics.boundary import MAX_POINTS, Boundary
from planner.mechanics.contacts import place_turned
from planner.mechanics.stepping import (
    ACCEPTED,
    GIVEN_UP,
    HELD,
    Body,
    Scratch,
    find_contacts,
    try_step,
)

STUCK, SLID, LOST = 0, 1, 2
PUSH_NAMES = ("stuck", "slid", "lost")
APART_MM = 0.05  # Gap at the end of a push above which the pusher has left the part
MAX_STEPS = 20_000
FINISHED = 1e-12  # Share of the way that may remain when a push counts as complete


class Paths(NamedTuple):
    """Paths of n pushers: the points of a pusher turn about a centre, which moves along a straight line."""

    points: Array  # (n, K, 2) points of the pushers at the start [mm]
    centres: Array  # (n, 2) centres of the rotations, at the start [mm]
    angles: Array  # (n,) angles of the rotations [rad]
    shifts: Array  # (n, 2) translations of the centres [mm]


class Pushers(NamedTuple):
    """The pushers of n pushes: each a set of points, or fingers whose pushing faces look down from y = 0."""

    paths: Paths
    way: Array  # (n,) upper bound on the way of the pusher's farthest point [mm]
    fingers: IntArray  # (n,) number of fingers; 0: the points push
    apart: Array  # (n,) x of the two fingers' middles, -apart and apart [mm]
    h: Array  # (n,) half a finger's length [mm]
    thickness: Array  # (n,) of a finger [mm]
    radius: Array  # (n,) of round tips about the points [mm]


class Mechanics(NamedTuple):
    """Limit surface and friction of each of n pushed parts."""

    surfaces: Array  # (n, 3, 3) ellipsoids or (n, 6, 6) quartics
    mu: Array  # (n, 2) friction; the first column is the friction of the pusher


class PushEnds(NamedTuple):
    """Final poses of n pushed parts, and how each push ended."""

    poses: Array  # (n, 3) poses of the parts in the pusher's frame at the start [mm, mm, rad]
    touching: IntArray  # (n,) 1 where the pusher touches the part
    given_up: IntArray  # (n,) 1 where the stepping failed: the part then moves with the pusher


def of_points(paths: Paths, radius_mm: float = 0.0) -> Pushers:
    """Pushers that touch the part with points, or with round tips of `radius_mm` about the points.

    Raises:
        ValueError: a pusher has more than `MAX_POINTS` points.
    """
    if paths.points.shape[1] > MAX_POINTS:
        raise ValueError(f"a pusher of {paths.points.shape[1]} points; give {MAX_POINTS} at most")
    n = len(paths.angles)
    arms = np.linalg.norm(paths.points - paths.centres[:, None], axis=2).max(axis=1)
    way = np.abs(paths.angles) * arms + np.hypot(*paths.shifts.T)
    none = np.zeros(n)
    return Pushers(paths, way, np.zeros(n, np.int64), none, none, none, np.full(n, radius_mm))


def of_fingers(opening_mm: Array, way_mm: Array, length_mm: float, thickness_mm: float) -> Pushers:
    """Pushers that are the ends of the two fingers of a hand, side by side along x.

    The fingers of pusher i move along -y by `way_mm[i]` [mm]. Where `opening_mm` (n,) is 0, the two fingers
    touch each other and count as one. `length_mm` and `thickness_mm` are the size of a finger.
    """
    n, closed = len(opening_mm), opening_mm <= 0.0
    shifts = np.column_stack([np.zeros(n), -way_mm])
    paths = Paths(np.zeros((n, 0, 2)), np.zeros((n, 2)), np.zeros(n), shifts)
    apart = np.where(closed, 0.0, 0.5 * (opening_mm + thickness_mm))
    h = np.where(closed, thickness_mm, 0.5 * thickness_mm)
    return Pushers(
        paths, way_mm, np.where(closed, 1, 2), apart, h, np.full(n, length_mm), np.zeros(n)
    )


@merged_kernel
def _push(body: Body, way: float, q: Array, scratch: Scratch) -> tuple[bool, bool]:
    """Pushes one part at pose q (3,) while the pusher moves by `way` [mm]; q becomes the final pose.

    Both poses are in the pusher's frame at the start [mm, mm, rad].

    Returns:
        Whether the pusher touches the part at the end, and whether the stepping failed, so that the part
        moved along with the pusher from there.
    """
    work, step = scratch.work, scratch.work.boundary.step
    work.step.F[0], work.step.F[1], work.step.F[2] = 0.0, 1.0, 0.0
    work.fingers[0] = work.fingers[1] = 0.0
    work.done, work.moved, work.heading[0], work.heading[1] = 0.0, 0, np.cos(q[2]), np.sin(q[2])
    start_x, start_y, start_angle = q[0], q[1], q[2]
    size, margin, verdict = step, 2.0 * step + APART_MM, ACCEPTED
    place_turned(body.outline, q, work.heading[0], work.heading[1], scratch.points)
    find_contacts(q, margin, scratch)
    for _ in range(MAX_STEPS):
        left = way - work.done
        if left <= FINISHED * way:
            break
        verdict, size = try_step(body, min(size, left), margin, q, scratch)
        if verdict >= HELD:
            work.moved = 1
        if verdict == GIVEN_UP:
            break
        if verdict == HELD:
            work.done, size = work.done + min(step, left), step
            find_contacts(q, margin, scratch)
        elif verdict == ACCEPTED:
            q[0], q[1], q[2] = work.trial[0], work.trial[1], work.trial[2]
    if work.moved == 0:
        q[0], q[1], q[2] = start_x, start_y, start_angle
    else:
        _carry(work.boundary, way, q)
    touching = False
    for k in range(work.count):
        touching = touching or work.step.contacts[k].gap <= APART_MM
    return touching, way - work.done > FINISHED * way


@inner_kernel
def _carry(boundary: Boundary, way: float, q: Array) -> None:
    """Converts a pose q (3,) from the pusher's frame at the end of its way to that at the start, in place."""
    angle, centre = way * boundary.turn, boundary.centre
    c, s = np.cos(angle), np.sin(angle)
    dx, dy = q[0] - centre[0], q[1] - centre[1]
    q[0] = centre[0] + way * boundary.x + c * dx - s * dy
    q[1] = centre[1] + way * boundary.y + s * dx + c * dy
    q[2] += angle


@inner_kernel
def _carry_by(boundary: Boundary, pushers: Pushers, i: int) -> None:
    """Copies the pusher of row i, with its path, into the boundary."""
    paths, way = pushers.paths, pushers.way[i]
    boundary.fingers, boundary.facing, boundary.apart = pushers.fingers[i], 1, pushers.apart[i]
    boundary.h, boundary.thickness = pushers.h[i], pushers.thickness[i]
    boundary.points, boundary.radius = paths.points.shape[1], pushers.radius[i]
    for k in range(boundary.points):
        boundary.pusher[k, 0], boundary.pusher[k, 1] = paths.points[i, k, 0], paths.points[i, k, 1]
    boundary.top_share = boundary.bottom_share = 0.0
    per_mm = 1.0 / way if way > 0.0 else 0.0
    boundary.x, boundary.y = per_mm * paths.shifts[i, 0], per_mm * paths.shifts[i, 1]
    boundary.turn = per_mm * paths.angles[i]
    boundary.centre[0], boundary.centre[1] = paths.centres[i, 0], paths.centres[i, 1]


@inner_kernel
def push_many(
    body: Body,
    step: float,
    pushers: Pushers,
    mechanics: Mechanics,
    ends: PushEnds,
    scratch: Scratch,
) -> None:
    """Pushes n parts, each with its own pusher and mechanics, in steps of at most `step` [mm].

    `ends.poses` (n, 3) holds the poses before the pushes; `ends` is filled in place. The limit surfaces are
    those of `mechanics`, not the surface of `body`.
    """
    mu, boundary = mechanics.mu, scratch.work.boundary
    for i in range(ends.poses.shape[0]):
        _carry_by(boundary, pushers, i)
        boundary.mu_top, boundary.mu_bottom, boundary.step = mu[i, 0], mu[i, 1], step
        pushed = Body(body.outline, body.reach, mechanics.surfaces[i], body.rho)
        touches, failed = _push(pushed, pushers.way[i], ends.poses[i], scratch)
        ends.touching[i], ends.given_up[i] = int(touches), int(failed)
