"""Contacts between a polygonal part and the two fingers, with their gaps.

Fingers are boxes with their sides along the axes. The inner faces of closing fingers look at each other; the
inner faces of fingers that push side by side look the same way. Four pairs of features can touch:

- FACE:   a vertex of the part on the inner face of a finger, normal along y;
- CORNER: an inner corner of a finger on an edge of the part, normal across the edge;
- END:    a vertex of the part on the end of a finger, normal along x;
- OUTER:  an outer corner of a finger on an edge of a part that reaches behind the finger.

A pusher of points or round tips (`find_points`) touches an edge as a finger's corner does (CORNER), and a
convex vertex (TIP).

A pair counts only where its normal lies in the normal cones of both features. This does not apply to an edge
that is nearly parallel to a finger's face: its pairs count, so that a finger also holds a flush edge that is
longer than the finger.

Outlines are stored as columns (2, N), so that loops over vertices are vectorised.
"""

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from planner.arrays import Array, IntArray
from planner.kernel import inlined_kernel, inner_kernel

FACE = 0
CORNER = 1
END = 2
OUTER = 3
TIP = 4

MAX_CONTACTS = 12
CONTACT = np.dtype(
    [
        *((name, np.float64) for name in ("x", "y", "nx", "ny", "gap", "low", "high")),
        *((name, np.float64) for name in ("n2", "t2", "un", "ut", "fn", "ft")),
        *((name, np.int64) for name in ("finger", "kind", "side", "vertex")),
    ]
)
"""A contact of the part with a finger.

x, y: place relative to the part's origin [mm]. nx, ny: unit normal into the part. gap [mm]. low, high: the
slips along the tangent (-ny, nx) after which the pair of features ends [mm]. n2, t2: moments of normal and
tangent over rho. un, ut: displacement of the finger along normal and tangent [mm]. fn, ft: force along normal
and tangent. finger: 1 for a finger that looks down, and for a pusher; -1 for a finger that looks up. kind:
`FACE` to `TIP`. side: end of the finger, by the sign of x, 0 for `FACE`; of a pusher, the number of the tip.
vertex: the vertex of the part that touches; where an edge touches, its first vertex; for `TIP`, the vertex
before the one that touches.
"""
Contact: TypeAlias = Any  # a record of `CONTACT`
Contacts: TypeAlias = Any  # (n,) records of `CONTACT`
NEARLY_PARALLEL = (
    0.08  # Sine of the angle up to which an edge counts as parallel to a finger's face
)
LEAST_ARM_MM = 0.5
"""Distance of a finger's corner from the vertex of a flush edge below which only the vertex counts."""
EDGE_SLACK_MM = 1e-9  # Distance past its end at which an edge still counts as touched, for rounding
OUTSIDE_MM = 5e-3  # A corner deeper than this behind all edges is inside the part
VERTEX_MM = 2e-4  # A point this near a vertex touches both edges; steps pass an end by less
DRIFT_MM = 0.02  # A pusher's point inside two edges by less than this touches both
PENETRATION_MM = 0.01  # Overlap at which a step is refused
DEEP_MM = 0.02  # Depth behind an edge from which a corner faces another edge, or edges overlap
FAR = 7  # Bits of `mark` for a vertex far from the fingers
END_DEPTH_MM = 0.01  # Least depth behind the inner face of a vertex that touches a finger's end


class Finger(NamedTuple):
    """A finger at one moment: a box |x - centre| <= h that extends from its inner face by its thickness."""

    side: int  # +1: its inner face looks down, -1: up
    centre: float  # x of its middle [mm]
    face: float  # y of its inner face [mm]
    h: float  # half its length [mm]
    thickness: float  # [mm]


class Tips(NamedTuple):
    """A pusher that touches the part with points, or with round tips centred at them."""

    centres: Array  # (K, 2) [mm]
    radius: float  # radius of each tip; 0 for points [mm]


class _Pair(NamedTuple):
    """Fields of a `CONTACT` record that say which finger touches which vertex or edge, and how."""

    finger: int
    kind: int
    side: int
    vertex: int


class _Geometry(NamedTuple):
    """Fields of a `CONTACT` record for gap, place, normal and slips; here, x and y are in the hand frame."""

    gap: float
    x: float
    y: float
    nx: float
    ny: float
    low: float
    high: float


class Hand(NamedTuple):
    """The fingers that may touch the part: both, or only the first."""

    first: Finger  # looks down
    second: Finger
    fingers: int  # 2: both may touch; 1: only the first


@inlined_kernel
def place(outline: Array, q: Array, points: Array) -> None:
    """Writes an outline (2, N), placed at pose q = (x, y, theta), into `points` (2, N)."""
    place_turned(outline, q, np.cos(q[2]), np.sin(q[2]), points)


@inlined_kernel
def place_turned(outline: Array, q: Array, c: float, s: float, points: Array) -> None:
    """Same as `place`, for a pose whose angle has the cosine c and the sine s."""
    for i in range(outline.shape[1]):
        points[0, i] = q[0] + c * outline[0, i] - s * outline[1, i]
        points[1, i] = q[1] + s * outline[0, i] + c * outline[1, i]


@inlined_kernel
def _slot(contacts: Contacts, count: int, gap: float) -> int:
    """Returns the row for a new contact with this gap: the next free row if there is one.

    If all rows are taken, the result is the row of the contact with the widest gap, which the new contact
    replaces. The result is -1 if no contact has a gap wider than `gap`.
    """
    if count < MAX_CONTACTS:
        return count
    widest = 0
    for k in range(MAX_CONTACTS):
        if contacts[k].gap > contacts[widest].gap:
            widest = k
    return widest if contacts[widest].gap > gap else -1


@inlined_kernel
def _write(contact: Contact, pair: _Pair, geometry: _Geometry) -> None:
    """Writes into a contact which features touch, and where."""
    contact.finger, contact.kind = pair.finger, pair.kind
    contact.side, contact.vertex = pair.side, pair.vertex
    contact.x, contact.y, contact.gap = geometry.x, geometry.y, geometry.gap
    contact.nx, contact.ny = geometry.nx, geometry.ny
    contact.low, contact.high = geometry.low, geometry.high


@inlined_kernel
def _slack_mm(points: Array, i: int) -> float:
    """How far beyond its end at vertex i an edge still counts as touched [mm].

    The distance is larger if the vertex is the bottom of a notch.
    """
    n = points.shape[1]
    b, j = i - 1 if i > 0 else n - 1, i + 1 if i + 1 < n else 0
    ax, ay = points[0, i] - points[0, b], points[1, i] - points[1, b]
    ex, ey = points[0, j] - points[0, i], points[1, j] - points[1, i]
    return PENETRATION_MM if ax * ey < ay * ex else EDGE_SLACK_MM


@inlined_kernel
def _hidden(points: Array, i: int, j: int, px: float, py: float, gap: float) -> bool:
    """Whether the point (px, py) touches a neighbour of edge i-j before it can touch edge i-j.

    At a convex vertex, a point that is outside one of the two edges is outside the part, so it can touch only
    the edge to which its gap is wider. `gap` is the gap to edge i-j. A point inside both edges overlaps the
    part; it is not hidden.
    """
    n = points.shape[1]
    b = i - 1 if i > 0 else n - 1
    k = j + 1 if j + 1 < n else 0
    ex, ey = points[0, j] - points[0, i], points[1, j] - points[1, i]
    for start, stop, turn in ((b, i, 1.0), (j, k, -1.0)):
        ax, ay = points[0, stop] - points[0, start], points[1, stop] - points[1, start]
        if turn * (ax * ey - ay * ex) > 0.0:
            other = (px - points[0, start]) * ay - (py - points[1, start]) * ax
            if other > max(gap, -OUTSIDE_MM) * np.sqrt(ax * ax + ay * ay) + EDGE_SLACK_MM:
                return True
    return False


@inlined_kernel
def _add_face(
    contacts: Contacts, count: int, points: Array, i: int, finger: Finger, margin: float
) -> int:
    """Adds the contact of vertex i with the inner face, if the vertex is near the face and not yet added.

    Returns:
        The new number of contacts.
    """
    side, h, x = finger.side, finger.h, points[0, i] - finger.centre
    gap = side * (finger.face - points[1, i])
    inside = h - abs(x)
    if inside < 0.0 or gap > margin or gap < -margin or (gap < 0.0 and inside < -gap):
        return count
    for k in range(count):
        other = contacts[k]
        if other.vertex == i and other.kind == FACE and other.finger == side:
            return count
    along = side * x
    slot = _slot(contacts, count, gap)
    if slot < 0:
        return count
    px, py = points[0, i], points[1, i]
    geometry = _Geometry(gap, px, py, 0.0, -float(side), -h - along, h - along)
    _write(contacts[slot], _Pair(side, FACE, 0, i), geometry)
    return min(count + 1, MAX_CONTACTS)


@inlined_kernel
def _add_corners(
    contacts: Contacts,
    count: int,
    points: Array,
    i: int,
    finger: Finger,
    kind: int,
    margin: float,
) -> int:
    """Adds contacts of the edge from vertex i to the next with the corners of a finger.

    The corners are the two inner ones (CORNER) or the two outer ones (OUTER), which face the other way. If
    the edge is nearly parallel to the inner face, contacts of its vertices with the face are added, too.

    Returns:
        The new number of contacts.
    """
    j, h = i + 1 if i + 1 < points.shape[1] else 0, finger.h
    outward = finger.side if kind == CORNER else -finger.side
    face = finger.face if kind == CORNER else finger.face + finger.side * finger.thickness
    x0, y0, x1, y1 = points[0, i], points[1, i], points[0, j], points[1, j]
    ex, ey = x1 - x0, y1 - y0
    length = np.sqrt(ex * ex + ey * ey)
    ex, ey = ex / length, ey / length
    if outward * ex > NEARLY_PARALLEL:
        return count
    for side in (-1, 1):
        if side * ey > NEARLY_PARALLEL:
            continue
        x = finger.centre + side * h
        dx, dy = x - x0, face - y0
        gap = dx * ey - dy * ex
        along = dx * ex + dy * ey
        if gap < -min(margin, DEEP_MM) or gap > margin:
            continue
        if along < -_slack_mm(points, i) or along > length + _slack_mm(points, j):
            continue
        lower = along if outward * y0 >= outward * y1 else length - along
        if side * ey > 0.0 and lower < LEAST_ARM_MM:
            continue
        if _hidden(points, i, j, x, face, gap):
            continue
        slot = _slot(contacts, count, gap)
        if slot < 0:
            continue
        count = min(count + 1, MAX_CONTACTS)
        rx, ry = x - gap * ey, face + gap * ex
        geometry = _Geometry(gap, rx, ry, -ey, ex, -along, length - along)
        _write(contacts[slot], _Pair(finger.side, kind, side, i), geometry)
        if kind == CORNER and abs(ey) <= NEARLY_PARALLEL:
            if along > LEAST_ARM_MM:
                count = _add_face(contacts, count, points, i, finger, margin)
            if length - along > LEAST_ARM_MM:
                count = _add_face(contacts, count, points, j, finger, margin)
    return count


@inner_kernel
def mark(points: Array, out: IntArray, hand: Hand, margin: float) -> None:
    """Writes the outcode of each vertex into `out` (N,): where the vertex lies relative to the fingers.

    The codes are those of Cohen and Sutherland's line clipping. If both ends of an edge have the same `FAR`
    bit, the edge is farther than `margin` from all fingers. If both ends have any bit in common, the edge
    runs no deeper than `PENETRATION_MM` into a finger.
    """
    first, second = hand.first, hand.second
    high, low = first.face, second.face if hand.fingers == 2 and second.side < 0 else -np.inf
    side = max(abs(first.centre), abs(second.centre)) + first.h + margin
    above = high - margin
    below = low + margin
    deep = high + PENETRATION_MM
    deep_below = low - PENETRATION_MM
    for i in range(points.shape[1]):
        x, y = points[0, i], points[1, i]
        between, outside = (y > below) & (y < above), (y >= deep_below) & (y <= deep)
        out[i] = between | ((x > side) << 1) | ((x < -side) << 2) | (outside << 3)


@inlined_kernel
def _add_pairs(
    contacts: Contacts, count: int, points: Array, i: int, finger: Finger, margin: float
) -> int:
    """Adds the contacts of a finger with vertex i and the edge that begins there; returns the new count."""
    n, side, h, thickness = points.shape[1], finger.side, finger.h, finger.thickness
    j, face = i + 1 if i + 1 < n else 0, side * finger.face
    y, after = side * points[1, i], side * points[1, j]
    if y < face - margin and after < face - margin:
        return count
    b = i - 1 if i > 0 else n - 1
    xi, xj = points[0, i] - finger.centre, points[0, j] - finger.centre
    before = side * points[1, b]
    if y >= face - margin and y >= before and y >= after and abs(xi) <= h:
        count = _add_face(contacts, count, points, i, finger, margin)
        if before >= after:
            count = _add_face(contacts, count, points, b, finger, margin)
        if after >= before:
            count = _add_face(contacts, count, points, j, finger, margin)
    if abs(xi) >= h - margin or abs(xj) >= h - margin:
        count = _add_corners(contacts, count, points, i, finger, CORNER, margin)
        if max(y, after) >= face + thickness - margin:
            count = _add_corners(contacts, count, points, i, finger, OUTER, margin)
    if END_DEPTH_MM < y - face < thickness and abs(xi) > h - margin:
        end = 1 if xi > 0.0 else -1
        gap = end * xi - h
        local = end * points[0, b] >= end * points[0, i] and end * xj >= end * xi
        if gap <= margin and local and (gap >= 0.0 or y - face >= -gap):
            slot = _slot(contacts, count, gap)
            if slot >= 0:
                px, py = points[0, i], points[1, i]
                geometry = _Geometry(gap, px, py, float(end), 0.0, -np.inf, np.inf)
                _write(contacts[slot], _Pair(side, END, end, i), geometry)
                count = min(count + 1, MAX_CONTACTS)
    return count


@inner_kernel
def find(
    contacts: Contacts, points: Array, out: IntArray, q: Array, hand: Hand, margin: float
) -> int:
    """Finds all contacts whose gaps are at most `margin` [mm]; returns their number.

    A vertex can touch an inner face if neither of its two neighbours is nearer to the face. The neighbour
    that is nearer to the face than the other one can then touch the face, too. The contacts are
    written into `contacts`, and the outcodes of `mark` into `out` (N,). `points` (2, N) is the outline in
    the hand frame, counter-clockwise [mm], of the part at pose q (3,).
    """
    n, count = points.shape[1], 0
    mark(points, out, hand, margin)
    for i in range(n):
        if out[i] & out[i + 1 if i + 1 < n else 0] & FAR:
            continue
        count = _add_pairs(contacts, count, points, i, hand.first, margin)
        if hand.fingers == 2:
            count = _add_pairs(contacts, count, points, i, hand.second, margin)
    for k in range(count):
        contacts[k].x -= q[0]
        contacts[k].y -= q[1]
    return count


@inner_kernel
def find_points(contacts: Contacts, points: Array, q: Array, pusher: Tips, margin: float) -> int:
    """Finds all contacts of a pusher's tips whose gaps are at most `margin` [mm]; returns their number.

    A tip touches an edge if it lies beside the edge and no neighbouring edge is in between. It touches a
    convex vertex if it lies in the normal cone of the vertex. In a notch a tip may touch both edges, even
    where it overlaps them. A round tip touches when its centre is one radius away. The contacts are written
    into `contacts`. `points` (2, N) is the outline in the pusher's frame, counter-clockwise [mm], of the part
    at pose q (3,).
    """
    n, radius = points.shape[1], pusher.radius
    count = 0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        b, k = i - 1 if i > 0 else n - 1, j + 1 if j + 1 < n else 0
        ex, ey = points[0, j] - points[0, i], points[1, j] - points[1, i]
        length = np.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        next_x, next_y = points[0, k] - points[0, j], points[1, k] - points[1, j]
        notch_before = (points[0, i] - points[0, b]) * ey - (points[1, i] - points[1, b]) * ex < 0.0
        notch_after = ex * next_y - ey * next_x < 0.0
        for finger in range(pusher.centres.shape[0]):
            px, py = pusher.centres[finger, 0], pusher.centres[finger, 1]
            dx, dy = px - points[0, i], py - points[1, i]
            along, away = dx * ex + dy * ey, dx * ey - dy * ex
            kind, nx, ny, low, high = CORNER, -ey, ex, -along, length - along
            if along > length + VERTEX_MM and not notch_after:
                dx, dy = px - points[0, j], py - points[1, j]
                away = np.sqrt(dx * dx + dy * dy)
                if dx * next_x + dy * next_y >= -VERTEX_MM * np.sqrt(
                    next_x * next_x + next_y * next_y
                ):
                    continue
                kind, nx, ny, low, high = TIP, -dx / away, -dy / away, -np.inf, np.inf
            elif along < (-margin if notch_before else -VERTEX_MM) or along > length + margin:
                continue
            gap = away - radius
            if abs(gap) > margin:
                continue
            drifted = 0.0 if -DRIFT_MM < away < 0.0 else away
            outside = radius > 0.0 and away > 0.0  # The edge beside a tip's centre is the nearest
            if kind == CORNER and not outside and _hidden(points, i, j, px, py, drifted):
                continue
            slot = _slot(contacts, count, gap)
            if slot >= 0:
                x, y = px + away * nx - q[0], py + away * ny - q[1]
                geometry = _Geometry(gap, x, y, nx, ny, low, high)
                _write(contacts[slot], _Pair(1, kind, finger, i), geometry)
                count = min(count + 1, MAX_CONTACTS)
    return count
