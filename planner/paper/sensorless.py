"""Orienting a part without sensors: the frictionless squeeze plan of Goldberg (1993), Algorithmica 10.

The width function is the distance of two parallel jaws that both touch the part. Its argument is the
closing direction phi in the part's frame: a part at angle theta in the hand frame, where the jaws close along
y, has phi = pi / 2 - theta. The period is pi. For all directions between two neighbouring normals of the
hull's edges, the jaws touch the same two vertices. So the width has its maxima within such arcs, and its
minima at their ends.

Long, frictionless jaws that touch the part at the same time turn the part until its width is at a local
minimum. The squeeze function maps each closing direction to that minimum: it is constant between two maxima
of the width.
A plan is a list of intervals of directions; one squeeze takes each interval into the next, narrower one. The
list is built backwards, in O(n^2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import Array
from planner.part.outline import Outline, convex_hull

FLUSH_RAD = 1e-9  # Edges whose normals differ by less than this count as parallel


@dataclass(frozen=True, slots=True, eq=False)
class WidthFunction:
    """The width of a part in every direction."""

    knots: Array  # (m,) directions of the normals of the hull's edges, in [0, pi), rising [rad]
    chords: Array  # (m, 2) for the arc from each knot to the next, vector between the touching vertices [mm]
    minima: Array  # (k,) directions of the local minima, in [0, pi), rising [rad]
    maxima: (
        Array  # (k,) directions of the local maxima; one minimum lies between two neighbours [rad]
    )

    def __call__(self, direction: Array) -> Array:
        """Widths [mm] of the part in some directions [rad], in an array of the same shape."""
        reduced = np.mod(direction, math.pi)
        # -1 is the last arc, which begins before pi.
        arc = np.searchsorted(self.knots, reduced, side="right") - 1
        chord = self.chords[arc]
        return np.abs(chord[..., 0] * np.cos(reduced) + chord[..., 1] * np.sin(reduced))

    def extrema(self, ripple_mm: float = 0.0) -> tuple[Array, Array]:
        """The minima and maxima that remain when ripples shallower than `ripple_mm` are smoothed out.

        A curve drawn as a polygon may have a minimum at an edge and a maximum at a vertex, a few micrometres
        apart. The shallowest pair is removed first; at least one minimum and one maximum are kept.
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
    """Returns the directions of the local minima and of the local maxima of the width.

    Minima lie at `knots` (m,), the normals of the edges, and maxima between two of these.
    """
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
    """Reduces directions to [0, pi); directions that rounding leaves just below pi become 0."""
    reduced = np.mod(direction, math.pi)
    return np.where(reduced > math.pi - FLUSH_RAD, 0.0, reduced)


def _slope(chords: Array, directions: Array) -> Array:
    """Derivative (m,) of the width by the direction [mm per rad].

    The width is the projection of a chord (m, 2) [mm] on a direction (m,) [rad]. Each chord has to point such
    that the projection is positive.
    """
    return np.asarray(chords[:, 1] * np.cos(directions) - chords[:, 0] * np.sin(directions))


RIPPLE_MM = 0.05  # Depth below which minima of the width are facets of a sampled curve
ALIKE_RAD = 1e-6  # Difference below which steps of the squeeze function are equal


@dataclass(frozen=True, slots=True, eq=False)
class SqueezeFunction:
    """A step function that maps a closing direction to the direction after a frictionless squeeze."""

    maxima: Array  # (k,) directions at which the steps of one period begin, rising [rad]
    minima: Array  # (k,) value of each step; it lies between this maximum and the next [rad]
    period: float  # a direction one period further on has a value one period further on [rad]

    @classmethod
    def of(cls, outline: Outline, ripple_mm: float = RIPPLE_MM) -> Self:
        """The squeeze function of a part (N, 2) [mm], without minima shallower than `ripple_mm`."""
        minima, maxima = width_function(outline).extrema(ripple_mm)
        if minima[0] < maxima[0]:
            minima = np.append(minima[1:], minima[0] + math.pi)
        k = len(maxima)
        steps = np.column_stack([np.diff(maxima, append=maxima[0] + math.pi), minima - maxima])
        order = next(n for n in range(k, 0, -1) if k % n == 0 and _repeats(steps, k // n))
        return cls(maxima[: k // order], minima[: k // order], math.pi / order)

    def __call__(self, direction: Array) -> Array:
        """Directions after a squeeze [rad], for closing directions `direction` [rad].

        The results are not reduced to one period.
        """
        turns = np.floor((direction - self.maxima[0]) / self.period)
        step = np.searchsorted(self.maxima, direction - turns * self.period, side="right") - 1
        return np.asarray(self.minima[np.maximum(step, 0)] + turns * self.period)

    def intervals(self) -> list[Interval]:
        """All intervals of consecutive steps that begin in the first period and span at most one period."""
        k = len(self.maxima)
        starts = np.concatenate([self.maxima, self.maxima + self.period])
        ends = np.concatenate([self.minima, self.minima + self.period])
        return [
            Interval(
                start=float(starts[first]),
                length=float(starts[first + steps] - starts[first]) if steps < k else self.period,
                image=float(ends[first]),
                spread=float(ends[first + steps - 1] - ends[first]),
            )
            for first in range(k)
            for steps in range(1, k + 1)
        ]


def _repeats(steps: Array, after: int) -> bool:
    """Whether a cyclic list of steps (k, 2) repeats: each step equals the one `after` places further on."""
    return np.allclose(steps, np.roll(steps, after, axis=0), rtol=0.0, atol=ALIKE_RAD)


class Interval(NamedTuple):
    """A run of steps of the squeeze function: an interval of closing directions."""

    start: float  # direction at which the interval begins [rad]
    length: float  # length of the interval [rad]
    image: float  # least direction of its image, the directions after a squeeze [rad]
    spread: float  # length of the smallest interval that contains the image [rad]


class SqueezePlan(NamedTuple):
    """A sensorless sequence of squeezes, and the angle at which it leaves the part."""

    angles: Array  # (k,) angle of the hand in the world at each squeeze, 0 at the first [rad]
    final: float  # final angle of the part in the world by the theory, modulo `period` [rad]
    period: float  # period of the final angle: pi, or less for a symmetric hull [rad]
    slack: float  # least distance of an intermediate direction from the end of its interval [rad]


def chain(function: SqueezeFunction) -> list[Interval]:
    """The plan's intervals, the widest first: from a whole period to a single step.

    The list is built backwards (Goldberg 1993), from its last interval, the widest single step. Each further
    interval goes to the front: the widest whose image is shorter than the interval that was in front so far.
    The list is complete when a whole period is in front.
    """
    intervals = function.intervals()
    whole = function.period - ALIKE_RAD
    results = [max((i for i in intervals if i.spread < ALIKE_RAD), key=lambda i: i.length)]
    while results[-1].length < whole:
        target = results[-1].length
        wider = [i for i in intervals if i.spread < target - ALIKE_RAD]
        best = max(wider, key=lambda i: (i.length, -i.spread))
        # Goldberg's theorem excludes this, unless lengths differ by less than `ALIKE_RAD`.
        if best.length <= target + ALIKE_RAD:
            break
        results.append(best)
    return results[::-1]


def plan(outline: Outline) -> SqueezePlan:
    """The shortest sequence of squeezes that orients a part (N, 2) [mm], in theory without friction."""
    function = SqueezeFunction.of(outline)
    intervals = chain(function)
    angles, slack = [0.0], 0.5 * function.period
    for before, after in pairwise(intervals):
        room = 0.5 * (after.length - before.spread)
        angles.append(angles[-1] + after.start + room - before.image)
        slack = min(slack, room)
    # The closing direction in the part's frame is phi = psi + pi / 2 - theta for a hand at psi.
    final = angles[-1] + 0.5 * math.pi - intervals[-1].image
    half = 0.5 * math.pi  # a hand turned by half a turn squeezes alike
    reduced = np.mod(np.array(angles) + half, math.pi) - half
    return SqueezePlan(reduced, final, function.period, slack)
