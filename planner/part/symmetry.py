"""The rotational symmetry of an outline: which turns of the part nobody can tell apart."""

import math
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.part.outline import Outline

TURNS = 8  # symmetries of up to so many turns are looked for
TOLERANCE_MM = 0.05  # How far boundaries may lie apart and still count as the same: far less than a count


class Turn(NamedTuple):
    """A turn that a part looks nearly the same after, but for which it has no symmetry."""

    degrees: float  # about the centroid
    apart_mm: float  # how far the outline lies from the turned one at most


def order(outline: Outline, tolerance_mm: float = TOLERANCE_MM) -> int:
    """The largest n for which `has_order` holds, at most the number of vertices; 1 always does."""
    boundary = _boundary(outline)
    return next(
        n for n in range(len(outline), 0, -1) if _maps_onto_itself(boundary, outline, n, tolerance_mm)
    )


def has_order(outline: Outline, n: int, tolerance_mm: float = TOLERANCE_MM) -> bool:
    """Whether each turn by a multiple of 2 pi / n takes a centred outline (N, 2) onto itself.

    All n - 1 turns must: a nearly round part passes any small one. The tolerance bounds the distance of a
    turned vertex from the boundary, and so that of a vertex from the turned boundary, by the inverse turn.
    """
    return _maps_onto_itself(_boundary(outline), outline, n, tolerance_mm)


def congruent(outline: Outline, other: Outline, tolerance_mm: float = TOLERANCE_MM) -> bool:
    """Whether some turn takes a centred outline (M, 2) onto another (N, 2), to within a tolerance.

    It takes a farthest vertex to a farthest vertex, so those are tried.
    """
    boundary, far = _boundary(other), np.hypot(*other.T)
    x, y = outline[np.argmax(np.hypot(*outline.T))]
    turns = [math.atan2(v[1], v[0]) - math.atan2(y, x) for v in other[far >= far.max() - tolerance_mm]]
    return any(bool(shapely.dwithin(boundary, _turned(outline, turn), tolerance_mm).all()) for turn in turns)


def nearest_turn(outline: Outline, symmetry: int) -> Turn:
    """The turn by a whole part of a circle after which an outline differs least; no symmetry of its own."""
    ring, found = shapely.linearrings(outline), []
    for parts in range(2, TURNS + 1):
        for k in range(1, parts // 2 + 1):
            if symmetry * k % parts:
                angle = math.tau * k / parts
                c, s = math.cos(angle), math.sin(angle)
                turned = shapely.linearrings(outline @ np.array([[c, s], [-s, c]]))
                apart = float(shapely.hausdorff_distance(ring, turned, densify=0.2))
                found.append(Turn(math.degrees(angle), apart))
    return min(found, key=lambda turn: turn.apart_mm)


def _maps_onto_itself(boundary: shapely.LinearRing, outline: Outline, n: int, tolerance_mm: float) -> bool:
    """Checks the turns one by one, those first that a part without this symmetry is likeliest to fail."""
    turns = np.arange(1, n)
    likely = np.argsort(np.abs(turns / n - 0.25), kind="stable")
    return all(
        bool(shapely.dwithin(boundary, _turned(outline, math.tau * k / n), tolerance_mm).all())
        for k in turns[likely]
    )


def _boundary(outline: Outline) -> shapely.LinearRing:
    boundary = shapely.linearrings(outline)
    shapely.prepare(boundary)
    return boundary


def _turned(outline: Outline, angle: float) -> NDArray[np.object_]:
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(shapely.points(outline @ np.array([[c, s], [-s, c]])))
