"""Moving boundaries that push a part: closing fingers, or a pusher that is carried along a path.

Coordinates are in the frame of the hand or of the pusher. A part that moves along with a pusher is at rest in
the pusher's frame: its pose there stays the same to the last bit, however long the path and the steps are.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array
from planner.kernel import inlined_kernel
from planner.mechanics.contacts import CORNER, OUTER, TIP, Contacts, Finger, Hand

MAX_POINTS = 16
BOUNDARY = np.dtype(
    [
        ("fingers", np.int64),
        ("facing", np.int64),
        ("apart", np.float64),
        ("h", np.float64),
        ("thickness", np.float64),
        ("points", np.int64),
        ("pusher", np.float64, (MAX_POINTS, 2)),
        ("radius", np.float64),
        ("mu_top", np.float64),
        ("mu_bottom", np.float64),
        ("top_share", np.float64),
        ("bottom_share", np.float64),
        ("x", np.float64),
        ("y", np.float64),
        ("turn", np.float64),
        ("centre", np.float64, 2),
        ("step", np.float64),
    ],
    align=True,
)
"""A moving boundary: the fingers, or the points of a pusher, and the motion of their frame.

fingers: number of fingers; 0 where points push. facing: -1 if the second finger looks up at the first, 1 if
both look down, side by side. apart: the middles of the two fingers lie at x = -apart and x = apart [mm]. h:
half the length of a finger [mm]. thickness: of a finger [mm]. points: number of points. pusher: coordinates
of the points [mm]. radius: of the round tips about the points; 0 for bare points [mm]. mu_top: friction
coefficient of the points, and of fingers that look down; mu_bottom: of a finger that looks up. top_share:
distance that a finger which looks down moves for each millimetre of a step; bottom_share: the same for a
finger that looks up. x, y, turn, centre: for each millimetre of a step, the frame turns by `turn` [rad] about
`centre` [mm], and `centre` moves straight by (x, y) [mm]. step: nominal length of a step [mm].

A record is passed to kernels as one pointer (decision 0005).
"""
Boundary: TypeAlias = Any


class Drive(NamedTuple):
    """Displacements of the fingers and of their frame in one step of a squeeze or a push."""

    top: float  # displacement of the finger that looks down [mm]
    bottom: float  # displacement of the finger that looks up [mm]
    x: float  # displacement of the frame over the table, at the part's origin [mm]
    y: float
    turn: float  # rotation of the frame [rad]


@inlined_kernel
def drive_of(boundary: Boundary, size: float, done: float, q: Array) -> Drive:
    """Computes how far a boundary moves in its next step, from its velocity after the distance `done`.

    Args:
        boundary: the fingers or the pusher.
        size: length of the step [mm].
        done: distance that the boundary has moved so far [mm].
        q: (3,) present pose of the part, in the boundary's frame.
    """
    turn = size * boundary.turn
    c, s = 1.0, 0.0
    if boundary.turn != 0.0:
        c, s = np.cos(done * boundary.turn), np.sin(done * boundary.turn)
    x = size * (c * boundary.x + s * boundary.y) - turn * (q[1] - boundary.centre[1])
    y = size * (c * boundary.y - s * boundary.x) + turn * (q[0] - boundary.centre[0])
    return Drive(boundary.top_share * size, boundary.bottom_share * size, x, y, turn)


@inlined_kernel
def hand_of(boundary: Boundary, faces: Array) -> Hand:
    """Returns the fingers of a boundary, with their inner faces at y = `faces` (2,) [mm]."""
    h, thickness, apart = boundary.h, boundary.thickness, boundary.apart
    first = Finger(1, -apart, faces[0], h, thickness)
    return Hand(first, Finger(boundary.facing, apart, faces[1], h, thickness), boundary.fingers)


@inlined_kernel
def directions(contacts: Contacts, count: int, rho: float, drive: Drive) -> None:
    """Computes the moments (the Jacobian of eq. 2) and the boundary's displacement at each contact.

    The results are written into the fields n2, t2, un and ut of the first `count` records of `contacts`.
    """
    for k in range(count):
        contact = contacts[k]
        nx, ny, rx, ry = contact.nx, contact.ny, contact.x, contact.y
        contact.n2, contact.t2 = (rx * ny - ry * nx) / rho, (rx * nx + ry * ny) / rho
        ux = drive.x - drive.turn * ry
        uy = drive.y + drive.turn * rx + (-drive.top if contact.finger == 1 else drive.bottom)
        contact.un, contact.ut = ux * nx + uy * ny, uy * nx - ux * ny


@inlined_kernel
def subtract_carriage(contacts: Contacts, count: int, rho: float, drive: Drive, V: Array) -> None:
    """Subtracts the motion of the boundary's frame over the table from all displacements, in place.

    `drive` states this motion. The displacement V (3,) of the part and the displacement of the boundary at
    each contact (fields un and ut) become relative to the frame. Within the frame a pusher is at rest, and
    the fingers of a squeeze close.
    """
    turn = rho * drive.turn
    V[0], V[1], V[2] = V[0] - drive.x, V[1] - drive.y, V[2] - turn
    for k in range(count):
        contact = contacts[k]
        contact.un -= contact.nx * drive.x + contact.ny * drive.y + contact.n2 * turn
        contact.ut -= contact.nx * drive.y - contact.ny * drive.x + contact.t2 * turn


@inlined_kernel
def turn(
    contacts: Contacts,
    count: int,
    turned: tuple[float, float],
    q: Array,
    half: Array,
    drive: Drive,
    radius: float,
) -> None:
    """Moves the places and normals of the contacts while the part moves from pose q to pose `half`.

    The midpoint rule uses this to place the contacts in the middle of a step. The gaps stay as they are. The
    part turns by an angle whose cosine and sine are `turned`, and the fingers close by half of `drive`. The
    normal of an edge turns with the part. The normal at a vertex is that of the finger, which does not turn;
    at a round tip (of `radius`) it points from the centre of the tip to the vertex.
    """
    c, s = turned
    for k in range(count):
        contact = contacts[k]
        rx, ry = contact.x, contact.y
        if contact.kind == CORNER or contact.kind == OUTER:
            nx, ny, gap = contact.nx, contact.ny, contact.gap + radius
            mx, my = c * nx - s * ny, s * nx + c * ny
            closed = -0.5 * drive.top if contact.finger == 1 else 0.5 * drive.bottom
            contact.nx, contact.ny = mx, my
            contact.x = q[0] + rx - gap * nx + gap * mx - half[0]
            contact.y = q[1] + ry - gap * ny + closed + gap * my - half[1]
        else:
            contact.x, contact.y = c * rx - s * ry, s * rx + c * ry
            if contact.kind == TIP and radius > 0.0:
                away = contact.gap + radius
                dx = half[0] + contact.x - (q[0] + rx - away * contact.nx)
                dy = half[1] + contact.y - (q[1] + ry - away * contact.ny)
                distance = np.sqrt(dx * dx + dy * dy)
                contact.nx, contact.ny = dx / distance, dy / distance
