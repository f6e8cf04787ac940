"""The rotational symmetry of an outline: turns after which the part looks the same."""

import itertools
import math
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LinearRing

from planner.part.outline import Outline, simplified

TURNS = 8  # largest n of the turns by k / n of a circle that `nearest_turn` tries
TOLERANCE_MM = 0.05  # Largest distance of boundaries that count as the same
FEW = 400  # most vertices of outlines whose distance is measured; the cost is quadratic
MOST_ORDER = 1000  # highest order that a table can state
SOME = 16  # number of vertices, spread from the least to the greatest radius, that are tried first


class Turn(NamedTuple):
    """A turn after which a part looks nearly the same, although the part lacks this symmetry."""

    degrees: float  # angle of the turn, about the centroid
    apart_mm: float  # Hausdorff distance of the outline from the turned one


def order(outline: Outline, tolerance_mm: float = TOLERANCE_MM) -> int:
    """The rotational order of an outline: the largest n that passes the test of `has_order`.

    The test is made with the given tolerance. Orders above `MOST_ORDER` or above the number of vertices are
    not tried.
    """
    boundary = _boundary(outline)
    orders = range(min(len(outline), MOST_ORDER), 0, -1)
    return next(n for n in orders if _maps_onto_itself(boundary, outline, n, tolerance_mm))


def has_order(outline: Outline, n: int) -> bool:
    """Whether each turn by a multiple of 2 pi / n takes a centred outline (N, 2) onto itself.

    All n - 1 turns are tested, since a nearly round part passes any small turn. Every turned vertex must lie
    within `TOLERANCE_MM` of the boundary. The inverse turns are tested too, so every vertex also lies within
    this tolerance of the turned boundary.
    """
    return _maps_onto_itself(_boundary(outline), outline, n, TOLERANCE_MM)


def congruent(outline: Outline, other: Outline, tolerance_mm: float = TOLERANCE_MM) -> bool:
    """Whether some turn takes a centred outline (M, 2) onto another (N, 2), to within a tolerance.

    Only turns are tried that take the vertex farthest from the centre to a vertex at the same distance.
    """
    boundary, far = _boundary(other), np.hypot(*other.T)
    x, y = outline[np.argmax(np.hypot(*outline.T))]
    farthest = other[far >= far.max() - tolerance_mm]
    turns = [math.atan2(v[1], v[0]) - math.atan2(y, x) for v in farthest]
    return any(_is_on(boundary, outline, turn, tolerance_mm) for turn in turns)


def nearest_turn(outline: Outline, symmetry: int) -> Turn:
    """Finds the turn that changes an outline least, among turns that are no symmetry of the outline.

    Tries turns by k / n of a circle, n up to `TURNS`; `symmetry` is the outline's rotational order.
    """
    outline = _with_few_vertices(outline)
    ring, result = shapely.linearrings(outline), []
    for parts in range(2, TURNS + 1):
        for k in range(1, parts // 2 + 1):
            if symmetry * k % parts:
                angle = math.tau * k / parts
                turned = shapely.linearrings(_turned(outline, angle))
                apart = float(shapely.hausdorff_distance(ring, turned, densify=0.2))
                result.append(Turn(math.degrees(angle), apart))
    return min(result, key=lambda turn: turn.apart_mm)


def _with_few_vertices(outline: Outline) -> Outline:
    """Simplifies an outline, with a tolerance that doubles until at most `FEW` vertices are left."""
    tolerance_mm = 0.1 * TOLERANCE_MM
    while len(outline) > FEW:
        outline, tolerance_mm = simplified(outline, tolerance_mm), 2.0 * tolerance_mm
    return outline


def _maps_onto_itself(boundary: LinearRing, outline: Outline, n: int, tolerance_mm: float) -> bool:
    """Whether every turn by a multiple of 360 / `n` degrees maps an outline onto itself.

    To refuse early, a few vertices are tried before all of them, and the angles that fail most often come
    first. An outline between two circles that differ by no more than the tolerance passes every turn.
    """
    radii = np.hypot(*outline.T)
    if radii.max() - shapely.distance(boundary, shapely.Point(0.0, 0.0)) <= tolerance_mm:
        return True
    some = outline[np.argsort(radii, kind="stable")[:: max(len(outline) // SOME, 1)]]
    if n > 1 and not _is_on(boundary, some, math.tau * max(round(n / 4), 1) / n, tolerance_mm):
        return False
    turns = np.arange(1, n)
    likely = turns[np.argsort(np.abs(turns / n - 0.25), kind="stable")]
    tried = itertools.product((some, outline), math.tau * likely / n)
    return all(_is_on(boundary, vertices, angle, tolerance_mm) for vertices, angle in tried)


def _is_on(boundary: LinearRing, vertices: Outline, angle: float, tolerance_mm: float) -> bool:
    turned = shapely.points(_turned(vertices, angle))
    return bool(shapely.dwithin(boundary, turned, tolerance_mm).all())


def _boundary(outline: Outline) -> LinearRing:
    boundary = shapely.linearrings(outline)
    shapely.prepare(boundary)
    return boundary


def _turned(outline: Outline, angle: float) -> Outline:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(outline @ np.array([[c, s], [-s, c]]))
