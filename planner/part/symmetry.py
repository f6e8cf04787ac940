"""The rotational symmetry of an outline: which turns of the part nobody can tell apart.

Means, tolerances and the success metric are all taken under the part's rotational order n (1 = none);
averaging with cos and sin of 2 theta, as the paper does, is right only for n = 2.
"""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from planner.part.outline import Outline

TOLERANCE_MM = 0.02
"""How far boundaries may lie apart and still count as the same."""


def order(outline: Outline, tolerance_mm: float = TOLERANCE_MM) -> int:
    """Return the rotational order of an outline about the origin.

    Bounded by the number of vertices: a regular polygon of N vertices has order N, and a disc drawn with N
    vertices gets order N too, as fine as its drawing.

    Args:
        outline: (N, 2), mm, centroid at the origin.
        tolerance_mm: see `has_order`.

    Returns:
        The largest n for which `has_order` holds; 1 always does.
    """
    boundary = _boundary(outline)
    return next(
        n for n in range(len(outline), 0, -1) if _maps_onto_itself(boundary, outline, n, tolerance_mm)
    )


def has_order(outline: Outline, n: int, tolerance_mm: float = TOLERANCE_MM) -> bool:
    """Tell whether each turn by a multiple of 2 pi / n takes the outline onto itself.

    Args:
        outline: (N, 2), mm, centroid at the origin.
        n: the order in question, at least 1.
        tolerance_mm: largest distance of a turned vertex from the boundary, and of a vertex from the turned
            boundary. The second follows from the first, since the turns of a group include their inverses.

    Returns:
        True if all n - 1 turns do. One turn alone would not do: a nearly round part passes any small turn.
    """
    return _maps_onto_itself(_boundary(outline), outline, n, tolerance_mm)


def _maps_onto_itself(boundary: shapely.LinearRing, outline: Outline, n: int, tolerance_mm: float) -> bool:
    """Check the turns one by one, those first that a part without this symmetry is likeliest to fail."""
    turns = np.arange(1, n)
    likely = np.argsort(np.abs(turns / n - 0.25), kind="stable")
    return all(
        bool(shapely.dwithin(boundary, _turned(outline, math.tau * k / n), tolerance_mm).all())
        for k in turns[likely]
    )


def _boundary(outline: Outline) -> shapely.LinearRing:
    """Return the boundary, indexed for many distance queries."""
    boundary = shapely.linearrings(outline)
    shapely.prepare(boundary)
    return boundary


def _turned(outline: Outline, angle: float) -> NDArray[np.object_]:
    """Return the vertices, turned by `angle` (rad) about the origin, as points."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(shapely.points(outline @ np.array([[c, s], [-s, c]])))
