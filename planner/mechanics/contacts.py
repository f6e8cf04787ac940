"""Contacts between a polygonal part and the two fingers, with their gaps.

Finger +1 closes downwards from y = top, finger -1 upwards from y = bottom; both are boxes |x| <= h that
extend outwards by their thickness. Three pairs of features can touch (planning notes, section 3):

- FACE:   a vertex of the part on the inner face of a finger, normal along y;
- CORNER: an inner corner of a finger on an edge of the part, normal across the edge;
- END:    a vertex of the part on the end of a finger, normal along x.

A pair counts only where its normal lies in the normal cones of both features, so that "vertex on face" and
"corner on edge" at the end of a finger are alternatives and never both; nearly parallel pairs are the
exception, for they are what holds a flush edge that is longer than the finger.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from planner.arrays import Array, IntArray

FACE = 0
CORNER = 1
END = 2

MAX_CONTACTS = 12
NEARLY_PARALLEL = 0.08
"""Sine of the angle below which an edge counts as parallel to a finger's face."""
EDGE_SLACK_MM = 1e-9


class Contacts(NamedTuple):
    """Contact buffers; the first `count` rows that `find` returned are valid.

    Attributes:
        r: (MAX_CONTACTS, 2) contact point minus the part's origin [mm].
        n: (MAX_CONTACTS, 2) unit normal into the part.
        gap: (MAX_CONTACTS,) distance along the normal [mm], negative where the bodies overlap.
        finger: (MAX_CONTACTS,) +1 or -1.
        kind: (MAX_CONTACTS,) FACE, CORNER or END.
        side: (MAX_CONTACTS,) sign of the finger end's x for CORNER and END.
        vertex: (MAX_CONTACTS,) the part's vertex, or the first vertex of its edge.
    """

    r: Array
    n: Array
    gap: Array
    finger: IntArray
    kind: IntArray
    side: IntArray
    vertex: IntArray


def buffers() -> Contacts:
    """Empty contact buffers."""
    k = MAX_CONTACTS
    ints = [np.zeros(k, np.int64) for _ in range(4)]
    return Contacts(np.zeros((k, 2)), np.zeros((k, 2)), np.zeros(k), *ints)


@njit(cache=True, nogil=True)
def place(outline: Array, q: Array, points: Array) -> None:
    """Outline in the hand frame at pose q = (x, y, theta); `points` (N, 2) is modified in place."""
    c, s = np.cos(q[2]), np.sin(q[2])
    for i in range(outline.shape[0]):
        points[i, 0] = q[0] + c * outline[i, 0] - s * outline[i, 1]
        points[i, 1] = q[1] + s * outline[i, 0] + c * outline[i, 1]


@njit(cache=True, nogil=True)
def _add(
    contacts: Contacts, count: int, gap: float, finger: int, kind: int, side: int, vertex: int, rx: float,
    ry: float, nx: float, ny: float,
) -> int:  # fmt: skip
    """Appends one contact, or replaces the widest gap where the buffers are full."""
    slot = count
    if count >= MAX_CONTACTS:
        slot = 0
        for k in range(MAX_CONTACTS):
            if contacts.gap[k] > contacts.gap[slot]:
                slot = k
        if contacts.gap[slot] <= gap:
            return count
        count -= 1
    contacts.r[slot, 0], contacts.r[slot, 1] = rx, ry
    contacts.n[slot, 0], contacts.n[slot, 1] = nx, ny
    contacts.gap[slot] = gap
    contacts.finger[slot], contacts.kind[slot] = finger, kind
    contacts.side[slot], contacts.vertex[slot] = side, vertex
    return count + 1


@njit(cache=True, nogil=True)
def _known(contacts: Contacts, count: int, finger: int, kind: int, vertex: int) -> bool:
    for k in range(count):
        if contacts.vertex[k] == vertex and contacts.kind[k] == kind and contacts.finger[k] == finger:
            return True
    return False


@njit(cache=True, nogil=True)
def _add_face(
    contacts: Contacts, count: int, points: Array, q: Array, i: int, finger: int, face: float, h: float,
    margin: float,
) -> int:  # fmt: skip
    """Adds vertex i on the inner face, where it is under the face and near."""
    gap = finger * (face - points[i, 1])
    inside = h - abs(points[i, 0])
    if inside < 0.0 or gap > margin or gap < -margin or (gap < 0.0 and inside < -gap):
        return count
    if _known(contacts, count, finger, FACE, i):
        return count
    rx, ry = points[i, 0] - q[0], points[i, 1] - q[1]
    return _add(contacts, count, gap, finger, FACE, 0, i, rx, ry, 0.0, -float(finger))


@njit(cache=True, nogil=True)
def _find_faces(
    contacts: Contacts, count: int, points: Array, q: Array, finger: int, face: float, h: float, margin: float
) -> int:
    """Local minima of the gap under the face, and the lower neighbour of each."""
    n = points.shape[0]
    for i in range(n):
        y = finger * points[i, 1]
        if finger * face - y > margin:
            continue
        before, after = (i - 1) % n, (i + 1) % n
        y_before, y_after = finger * points[before, 1], finger * points[after, 1]
        if y < y_before or y < y_after:
            continue
        known = count
        count = _add_face(contacts, count, points, q, i, finger, face, h, margin)
        if count == known and abs(points[i, 0]) > h:
            continue
        neighbour = before if y_before > y_after else after
        count = _add_face(contacts, count, points, q, neighbour, finger, face, h, margin)
        if y_before == y_after:
            count = _add_face(contacts, count, points, q, before, finger, face, h, margin)
    return count


@njit(cache=True, nogil=True)
def _find_corners(
    contacts: Contacts, count: int, points: Array, q: Array, finger: int, face: float, h: float, margin: float
) -> int:
    """Edges of the part at the two inner corners of a finger."""
    n = points.shape[0]
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        low, high = min(x0, x1) - margin, max(x0, x1) + margin
        if (low > h or high < h) and (low > -h or high < -h):
            continue
        if max(finger * y0, finger * y1) < finger * face - margin:
            continue
        ex, ey = x1 - x0, y1 - y0
        length = np.sqrt(ex * ex + ey * ey)
        ex, ey = ex / length, ey / length
        if -finger * ex < -NEARLY_PARALLEL:
            continue
        for side in (-1, 1):
            if side * ey > NEARLY_PARALLEL:
                continue
            dx, dy = side * h - x0, face - y0
            gap = dx * ey - dy * ex
            along = dx * ex + dy * ey
            if gap < -margin or gap > margin or along < -EDGE_SLACK_MM or along > length + EDGE_SLACK_MM:
                continue
            rx, ry = side * h - gap * ey - q[0], face + gap * ex - q[1]
            count = _add(contacts, count, gap, finger, CORNER, side, i, rx, ry, -ey, ex)
    return count


@njit(cache=True, nogil=True)
def _find_ends(
    contacts: Contacts, count: int, points: Array, q: Array, finger: int, face: float, h: float,
    thickness: float, margin: float, depth: float,
) -> int:  # fmt: skip
    """Vertices beside a finger, deeper than `depth` behind its inner face, near one of its ends."""
    n = points.shape[0]
    for i in range(n):
        behind = finger * (points[i, 1] - face)
        if behind < depth or behind > thickness:
            continue
        side = 1 if points[i, 0] > 0.0 else -1
        gap = side * points[i, 0] - h
        if gap > margin or gap < -margin or (gap < 0.0 and behind < -gap):
            continue
        before, after = (i - 1) % n, (i + 1) % n
        if side * points[before, 0] < side * points[i, 0] or side * points[after, 0] < side * points[i, 0]:
            continue
        rx, ry = points[i, 0] - q[0], points[i, 1] - q[1]
        count = _add(contacts, count, gap, finger, END, side, i, rx, ry, float(side), 0.0)
    return count


@njit(cache=True, nogil=True)
def find(
    contacts: Contacts, points: Array, q: Array, top: float, bottom: float, h: float, thickness: float,
    margin: float,
) -> int:  # fmt: skip
    """Finds all pairs of features that are within `margin` of touching.

    Args:
        contacts: buffers, modified in place.
        points: (N, 2) outline in the hand frame, counter-clockwise [mm].
        q: (3,) the part's pose in the hand frame [mm, mm, rad].
        top: y of the upper finger's inner face [mm].
        bottom: y of the lower finger's inner face [mm].
        h: half the finger's length [mm].
        thickness: the finger's thickness [mm].
        margin: largest gap reported [mm].

    Returns:
        The number of contacts.
    """
    count = 0
    depth = 0.01
    for finger in (1, -1):
        face = top if finger == 1 else bottom
        count = _find_faces(contacts, count, points, q, finger, face, h, margin)
        count = _find_corners(contacts, count, points, q, finger, face, h, margin)
        count = _find_ends(contacts, count, points, q, finger, face, h, thickness, margin, depth)
    return count


@njit(cache=True, nogil=True)
def clearance(points: Array, finger: int, face: float, h: float) -> float:
    """Distance a finger can close before it touches the part: exact, by rays along y.

    Args:
        points: (N, 2) outline in the hand frame [mm].
        finger: +1 or -1.
        face: y of its inner face [mm].
        h: half the finger's length [mm].

    Returns:
        The distance [mm], infinite where the part lies beside the finger.
    """
    n = points.shape[0]
    nearest = np.inf
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        if abs(x0) <= h:
            nearest = min(nearest, finger * (face - y0))
        for side in (-1, 1):
            x = side * h
            if (x0 - x) * (x1 - x) < 0.0:
                y = y0 + (y1 - y0) * (x - x0) / (x1 - x0)
                nearest = min(nearest, finger * (face - y))
    return nearest


@njit(cache=True, nogil=True)
def penetration(points: Array, finger: int, face: float, h: float, thickness: float) -> float:
    """Depth to which part and finger box overlap [mm]; 0 where they do not.

    The depth of a vertex is its least distance to the box's boundary; the depth of an inner corner of the
    finger is its distance to the nearest edge of the part.
    """
    n = points.shape[0]
    deepest = 0.0
    inside_left, inside_right = False, False
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        behind = finger * (y0 - face)
        if behind > 0.0 and abs(x0) < h and behind < thickness:
            deepest = max(deepest, min(behind, h - abs(x0), thickness - behind))
        if (x0 > h) != (x1 > h) and y0 + (y1 - y0) * (h - x0) / (x1 - x0) > face:
            inside_right = not inside_right
        if (x0 > -h) != (x1 > -h) and y0 + (y1 - y0) * (-h - x0) / (x1 - x0) > face:
            inside_left = not inside_left
    if inside_right:
        deepest = max(deepest, _edge_distance(points, h, face))
    if inside_left:
        deepest = max(deepest, _edge_distance(points, -h, face))
    return deepest


@njit(cache=True, nogil=True)
def _edge_distance(points: Array, x: float, y: float) -> float:
    """Distance of a point to the outline [mm]."""
    n = points.shape[0]
    nearest = np.inf
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        ex, ey = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        dx, dy = x - points[i, 0], y - points[i, 1]
        along = min(max((dx * ex + dy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
        nearest = min(nearest, (dx - along * ex) ** 2 + (dy - along * ey) ** 2)
    return float(np.sqrt(nearest))
