"""A push: a rigid pusher follows a commanded path, and the part gives way.

The pusher is a set of points, or the fingers of a hand that goes straight on. The contacts are solved as in
a squeeze (`surface_step.solve_surface`); only the pusher's displacement at each contact is another one. The
part never jams: to move along with the pusher is always possible. That is what it does where friction wedges
it between two places of the pusher, and the LCP has no solution.
"""

from typing import NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inner_kernel, kernel
from planner.mechanics.contacts import GAP, N2, NX, NY, RX, RY, T2, UN, UT, add_sides, find_points, place
from planner.mechanics.lcp import SOLVED
from planner.mechanics.step import event_fraction
from planner.mechanics.stepping import SMALLEST_STEP, Body, SqueezeWork
from planner.mechanics.surface_step import solve_surface

STUCK, SLID, LOST = 0, 1, 2
PUSH_NAMES = ("stuck", "slid", "lost")
APART_MM = 0.05  # A wider gap at the end of a push: the pusher has left the part
TRIES = 50  # Steps tried, for each step of full length that the path has
WEDGED = 0.25  # Share of a full step, from which on a part is taken along where no LCP is solved
FINISHED = 1e-9  # What may be left of a path that is followed to its end, as a share of it
FAR_MM = 1e9  # Where a finger is that is not there


class Path(NamedTuple):
    """What the pusher does: its points turn about a centre, which moves along a straight line meanwhile."""

    points: Array  # (K, 2) at the start [mm]
    centre: Array  # (2,) of the rotation, at the start [mm]
    angle: float  # of the rotation [rad]
    shift: Array  # (2,) translation [mm]


class Paths(NamedTuple):
    """n paths of pushers with as many points each."""

    points: Array  # (n, K, 2)
    centres: Array  # (n, 2)
    angles: Array  # (n,)
    shifts: Array  # (n, 2)


@inner_kernel
def moved_along(path: Path, share: float, start: Array, out: Array) -> None:
    """Where the pusher takes points (K, 2) in a share of its path, into `out` (K, 2)."""
    c, s = np.cos(share * path.angle), np.sin(share * path.angle)
    for k in range(start.shape[0]):
        dx, dy = start[k, 0] - path.centre[0], start[k, 1] - path.centre[1]
        out[k, 0] = path.centre[0] + c * dx - s * dy + share * path.shift[0]
        out[k, 1] = path.centre[1] + s * dx + c * dy + share * path.shift[1]


@inner_kernel
def _command(C: Array, count: int, rho: float, path: Path, done: float, share: float, q: Array) -> None:
    """Moments of all contacts and the pusher's displacements there, of a further share of the path.

    To first order, as the LCP takes the part's: so a part that moves along with the pusher does not slip.
    """
    angle = share * path.angle
    for k in range(count):
        nx, ny, rx, ry = C[k, NX], C[k, NY], C[k, RX], C[k, RY]
        C[k, N2], C[k, T2] = (rx * ny - ry * nx) / rho, (rx * nx + ry * ny) / rho
        ux = share * path.shift[0] - angle * (q[1] + ry - path.centre[1] - done * path.shift[1])
        uy = share * path.shift[1] + angle * (q[0] + rx - path.centre[0] - done * path.shift[0])
        C[k, UN], C[k, UT] = ux * nx + uy * ny, uy * nx - ux * ny


@inner_kernel
def _take_along(path: Path, rho: float, done: float, share: float, q: Array, V: Array) -> None:
    """The displacement of a part that moves with the pusher in a further share of the path, into V (3,)."""
    angle = share * path.angle
    V[0] = share * path.shift[0] - angle * (q[1] - path.centre[1] - done * path.shift[1])
    V[1] = share * path.shift[1] + angle * (q[0] - path.centre[0] - done * path.shift[0])
    V[2] = rho * angle


@inner_kernel
def _move(q: Array, dx: float, dy: float, angle: float) -> None:
    """Moves a pose (3,) by a constant twist: so a part that sticks keeps to the pusher's circle."""
    along, across = 1.0, 0.5 * angle
    if abs(angle) > 1e-8:
        along, across = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle
    q[0] += along * dx - across * dy
    q[1] += across * dx + along * dy
    q[2] += angle


@inner_kernel
def _steps(path: Path, step: float) -> int:
    """How many steps the path has, if no point of the pusher is to go further than `step` in one."""
    farthest = 0.0
    for k in range(path.points.shape[0]):
        dx, dy = path.points[k, 0] - path.centre[0], path.points[k, 1] - path.centre[1]
        farthest = max(farthest, np.sqrt(dx * dx + dy * dy))
    length = abs(path.angle) * farthest + np.sqrt(path.shift[0] ** 2 + path.shift[1] ** 2)
    return int(np.ceil(length / step)) + 1


def fingers_of(opening_mm: Array, length_mm: float, thickness_mm: float) -> Array:
    """The fingers of n hands as boxes (n, 2, 4): x and y of their least and greatest corners [mm].

    Where fingers touch one another (`opening_mm` (n,) is 0) the first box is both of them, the other far off.
    """
    half, h, closed = 0.5 * opening_mm, np.full(len(opening_mm), 0.5 * length_mm), opening_mm <= 0.0
    upper = np.column_stack([-h, np.where(closed, -thickness_mm, half), h, half + thickness_mm])
    lower = np.column_stack([-h, -half - thickness_mm, h, -half])
    lower[closed] += FAR_MM
    return np.stack([upper, lower], axis=1)


def corners_of(boxes: Array) -> Array:
    """The corners (n, 4 m, 2) of boxes (n, m, 4)."""
    pairs = [boxes[:, :, [i, j]] for i in (0, 2) for j in (1, 3)]
    return np.concatenate(pairs, axis=1)


@kernel
def push(
    body: Body, path: Path, boxes: Array, mu: float, step: float, q: Array, points: Array, pusher: Array,
    work: SqueezeWork,
) -> tuple[bool, bool]:  # fmt: skip
    """Pushes one part at q (3,), which is modified into the final pose [mm, mm, rad].

    The path's points may be the corners of `boxes` (m, 4) with their sides along the axes, which no path then
    turns; there are none (0, 4) where points alone push. mu is the friction between pusher and part, `step`
    the most that the pusher goes in one step [mm]. Workspaces are `points` (2, N), `pusher` (K, 2), `work`.

    Returns:
        Whether the pusher touches the part at the end, and whether the path was followed to its end.
    """
    C, I, V = work.step.C, work.step.I, work.step.V
    margin = 2.0 * step + APART_MM
    full = 1.0 / _steps(path, step)
    work.step.F[0], work.step.F[1], work.step.F[2] = 0.0, 1.0, 0.0
    done, share = 0.0, full
    for _ in range(int(TRIES / full)):
        place(body.outline, q, points)
        moved_along(path, done, path.points, pusher)
        count = find_points(C, I, points, q, pusher, margin)
        dx, dy = done * path.shift[0], done * path.shift[1]
        count = add_sides(C, I, count, points, q, boxes, dx, dy, margin)
        if done >= 1.0 - FINISHED:
            break
        share = min(share, 1.0 - done)
        _command(C, count, body.rho, path, done, share, q)
        status = solve_surface(body.surface, np.cos(q[2]), np.sin(q[2]), mu, mu, count, work.step)
        if status != SOLVED:
            if share > WEDGED * full:
                share *= WEDGED
                continue
            _take_along(path, body.rho, done, share, q, V)
        fraction = event_fraction(C, count, V, V)
        if fraction < 0.95 and share > full * SMALLEST_STEP:
            share *= max(fraction, SMALLEST_STEP)
            continue
        _move(q, V[0], V[1], V[2] / body.rho)
        done, share = done + share, min(full, 2.0 * share)
    touching = False
    for k in range(count):
        touching = touching or C[k, GAP] <= APART_MM
    return touching, done >= 1.0 - FINISHED


@kernel
def push_many(
    outline: Array, surfaces: Array, rho: float, mu: Array, step: float, paths: Paths, boxes: Array,
    poses: Array, touching: IntArray, given_up: IntArray, work: SqueezeWork,
) -> None:  # fmt: skip
    """`push` for every row of `poses` (n, 3), each with its own of the rest; outputs in place.

    That is surfaces, mu (n, 2), the path, and the boxes (n, m, 4).
    """
    columns, pusher = np.ascontiguousarray(outline.T), np.zeros(paths.points.shape[1:])
    placed = np.zeros(columns.shape)
    reach = np.sqrt((outline[:, 0] ** 2 + outline[:, 1] ** 2).max())
    for i in range(poses.shape[0]):
        body = Body(columns, reach, surfaces[i], rho)
        path = Path(paths.points[i], paths.centres[i], paths.angles[i], paths.shifts[i])
        touches, followed = push(
            body, path, boxes[i], mu[i, 0], step, poses[i], placed, pusher, work
        )  # fmt: skip
        touching[i], given_up[i] = int(touches), int(not followed)
