"""How far a finger may close before it touches the part, and whether it can be set down beside it at all."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.kernel import kernel

BEHIND_MM = 0.1
"""What lies further than this behind an inner face is beside or behind the finger, not before it."""


@kernel
def clearance(points: Array, finger: int, face: float, h: float) -> float:
    """Distance a finger can close before it touches the part: exact, by rays along y.

    Args:
        points: (N, 2) outline in the hand frame [mm].
        finger: +1 or -1.
        face: y of its inner face [mm].
        h: half the finger's length [mm].

    Returns:
        The distance [mm], infinite where the part lies beside or behind the finger.
    """
    n = points.shape[0]
    nearest = np.inf
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
        gap = finger * (face - y0)
        if abs(x0) <= h and gap > -BEHIND_MM:
            nearest = min(nearest, gap)
        for side in (-1, 1):
            x = side * h
            if (x0 - x) * (x1 - x) < 0.0:
                gap = finger * (face - y0 - (y1 - y0) * (x - x0) / (x1 - x0))
                if gap > -BEHIND_MM:
                    nearest = min(nearest, gap)
    return nearest


@kernel
def crosses(x0: float, y0: float, x1: float, y1: float, half_x: float, half_y: float) -> bool:
    """Whether a segment runs through the inside of the box |x| < half_x, |y| < half_y (Liang and Barsky)."""
    start, end = 0.0, 1.0
    for origin, step, half in ((x0, x1 - x0, half_x), (y0, y1 - y0, half_y)):
        if abs(step) < 1e-12:
            if abs(origin) >= half:
                return False
        else:
            enter, leave = (-half - origin) / step, (half - origin) / step
            start, end = max(start, min(enter, leave)), min(end, max(enter, leave))
    return end - start > 1e-9


@kernel
def blocked(points: Array, finger: int, face: float, h: float, thickness: float) -> bool:
    """Whether part and finger box share any area: the finger cannot be set down there.

    Args:
        points: (N, 2) outline in the hand frame [mm].
        finger: +1 or -1.
        face: y of its inner face [mm].
        h: half the finger's length [mm].
        thickness: the finger's thickness [mm].
    """
    n = points.shape[0]
    inside = False
    middle = face + 0.5 * finger * thickness
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        x0, y0, x1, y1 = points[i, 0], points[i, 1] - middle, points[j, 0], points[j, 1] - middle
        if (y0 > 0.0) != (y1 > 0.0) and x0 + (x1 - x0) * y0 / (y0 - y1) > 0.0:
            inside = not inside
        if crosses(x0, y0, x1, y1, h, 0.5 * thickness):
            return True
    return inside
