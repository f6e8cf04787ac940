"""The width function of a part: how far apart two parallel jaws stand that both touch it (Goldberg 1993).

Its argument is the closing direction phi in the part's frame: a part at angle theta in the hand frame, where
the jaws close along y, has phi = pi / 2 - theta. The period is pi. Between the normals of the hull's edges
two fixed vertices touch: maxima lie within such an arc and minima at its ends.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.part.outline import Outline, convex_hull

FLUSH_RAD = 1e-9  # Edges whose normals differ by less than this are parallel


@dataclass(frozen=True, slots=True, eq=False)
class WidthFunction:
    """The width of a part in every direction."""

    knots: Array  # (m,) the normals of the hull's edges, reduced to [0, pi), rising
    chords: Array  # (m, 2) from each knot to the next, the vector between the two vertices that touch [mm]
    minima: Array  # (k,) directions of the local minima, in [0, pi), rising
    maxima: Array  # (k,) and of the local maxima; between two of them lies one minimum

    def __call__(self, direction: Array) -> Array:
        """Widths in some directions [rad] -> [mm]."""
        reduced = np.mod(direction, math.pi)
        arc = np.searchsorted(self.knots, reduced, side="right") - 1  # -1: the last one, from before pi
        chord = self.chords[arc]
        return np.abs(chord[..., 0] * np.cos(reduced) + chord[..., 1] * np.sin(reduced))

    def extrema(self, ripple_mm: float = 0.0) -> tuple[Array, Array]:
        """The minima and maxima that are left when ripples shallower than `ripple_mm` are smoothed out.

        A curve drawn as a polygon may have a minimum at an edge and a maximum at a vertex, a few micrometres
        apart. The shallowest pair goes first; at least one minimum and one maximum are kept.
        """
        at = np.concatenate([self.minima, self.maxima])
        order = np.argsort(at)
        kinds = order < len(self.minima)  # True: a minimum; the two alternate
        at, depth = at[order], self(at)[order]
        while len(at) > 2:
            steps = np.abs(np.roll(depth, -1) - depth)
            first = int(np.argmin(steps))
            if steps[first] >= ripple_mm:
                break
            kept = np.setdiff1d(np.arange(len(at)), [first, (first + 1) % len(at)])
            at, depth, kinds = at[kept], depth[kept], kinds[kept]
        return at[kinds], at[~kinds]


def width_function(outline: Outline) -> WidthFunction:
    """The width function of the convex hull of a part (N, 2), counter-clockwise [mm]."""
    hull = convex_hull(outline)
    edges = np.roll(hull, -1, axis=0) - hull
    normals = np.sort(_reduced(np.arctan2(-edges[:, 0], edges[:, 1])))
    knots = normals[np.diff(normals, prepend=normals[-1] - math.pi) > FLUSH_RAD]
    middles = knots + 0.5 * np.diff(knots, append=knots[0] + math.pi)
    along = hull @ np.array([np.cos(middles), np.sin(middles)])  # (vertices, arcs)
    chords = hull[along.argmax(axis=0)] - hull[along.argmin(axis=0)]
    return WidthFunction(knots, chords, *_extrema(knots, chords))


def _extrema(knots: Array, chords: Array) -> tuple[Array, Array]:
    """Local minima, among the knots, and local maxima, within the arcs."""
    slope_after = _slope(chords, knots)
    before = np.roll(chords, 1, axis=0)
    before[0] *= -1.0  # the last arc lies half a turn further on
    slope_before = _slope(before, knots)
    minima = knots[(slope_before < 0.0) & (slope_after > 0.0)]
    ends = np.append(knots[1:], knots[0] + math.pi)
    within = (slope_after > 0.0) & (_slope(chords, ends) < 0.0)
    maxima = _reduced(np.arctan2(chords[within, 1], chords[within, 0]))
    return minima, np.sort(maxima)


def _reduced(direction: Array) -> Array:
    """Directions in [0, pi); what rounding put just below pi is 0."""
    reduced = np.mod(direction, math.pi)
    return np.where(reduced > math.pi - FLUSH_RAD, 0.0, reduced)


def _slope(chords: Array, directions: Array) -> Array:
    """Derivative of the chords' extent along directions [mm per rad]; the chords point along them."""
    return np.asarray(chords[:, 1] * np.cos(directions) - chords[:, 0] * np.sin(directions))
