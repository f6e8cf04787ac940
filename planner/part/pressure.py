"""Pressure of the part on the table: the distribution over which friction with the table is integrated.

Everything is in the part's frame, whose origin is the outline's centroid. If the centre of pressure lies
elsewhere, the limit surface couples forces and torques.
"""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, TypeAlias

import numpy as np
import shapely

from planner.arrays import Array
from planner.part.outline import Outline, convex_hull

Kind = Literal["boundary", "uniform", "points", "identified", "stated"]

CELLS = 400
"""Least number of pieces of a boundary or an area: the friction integral is exact to 0.1 % or better."""
HULL_CORNERS = 24
"""Most corners of a hull at which feet are tried; every few vertices of a dense curve suffice."""
ON_EDGE = 1e-9  # a centre this far outside, as a share of the triangle's area, is on the edge


@dataclass(frozen=True, slots=True, eq=False)
class Pressure:
    """The supporting pressure, or a limit surface in its place.

    Its kind is "boundary" (even along the outline, as the paper assumes), "uniform" (even over the area),
    "points" (discrete supports), "identified" (a limit surface from pushes) or "stated" (an ellipsoid).
    """

    kind: Kind
    wishart_dof: int  # degrees of freedom n_df of the random ellipsoids (paper, IV, footnote 1)
    # Form fitted to the pressure: "ellipsoid", "quartic", or "any" (ellipsoid, with the quartic as a doubt).
    limit_surface: str | None = None
    points_mm: Array | None = None  # (M, 2) supports in the part's frame, for "points"
    weights: Array | None = None  # (M,) share of the load on each support, of sum 1, for "points"
    ellipsoid: Array | None = None  # (3, 3) A with F^T A F = 1, F = [fx, fy, tau/rho] / (mu N)
    rho_mm: float | None = None  # the rho that `ellipsoid` or `quartic` is normalised with
    quartic: Array | None = None  # (15,) coefficients (`planner.mechanics.quartic`)
    certificate: Array | None = None  # (9, 9) certificate that `quartic` is convex


Support: TypeAlias = tuple[Array, Array]
"""A pressure distribution: points (M, 2) in the part's frame [mm], and positive weights (M,) of sum 1."""


def support(pressure: Pressure, outline: Outline) -> Support:
    """Returns the pressure under an outline (N, 2) as weighted points.

    The centre and the second moments of these points are exactly those of the pressure.

    Raises:
        ValueError: a limit surface replaces the pressure, so there is no distribution.
    """
    if pressure.kind == "boundary":
        return _boundary_support(outline)
    if pressure.kind == "uniform":
        return _area_support(outline)
    if pressure.points_mm is None or pressure.weights is None:
        raise ValueError(f"pressure of kind {pressure.kind!r} has no support points")
    return pressure.points_mm, pressure.weights


def even(points: Array) -> Support:
    """Distributes the load evenly over points (M, 2)."""
    return _normalised(points, np.ones(len(points)))


def stances(outline: Outline) -> Array:
    """Returns sets of three corners (k, 3, 2) of an outline's hull on which the part stands without tipping.

    The part's centre, the origin, lies in the triangle of the three corners or on its edge.
    """
    hull = convex_hull(outline)
    corners = hull[:: -(-len(hull) // HULL_CORNERS)]  # counter-clockwise, and so are the triangles
    if not shapely.contains_xy(shapely.polygons(corners), 0.0, 0.0):
        # Most vertices may belong to one curve: take the farthest ones in evenly spread directions.
        turn = np.arange(HULL_CORNERS) * 2.0 * np.pi / HULL_CORNERS
        corners = hull[np.unique(np.argmax(hull @ np.stack([np.cos(turn), np.sin(turn)]), axis=0))]
    feet = corners[list(combinations(range(len(corners)), 3))]
    following = np.roll(feet, -1, axis=1)
    # (k, 3) twice the areas
    shares = feet[..., 0] * following[..., 1] - following[..., 0] * feet[..., 1]
    return np.asarray(feet[np.all(shares >= -ON_EDGE * shares.sum(axis=1)[:, None], axis=1)])


def _boundary_support(outline: Outline) -> Support:
    """Returns an even pressure along the outline.

    Each edge is cut into equal pieces, and each piece has two Gauss points. So the moments of the pressure
    along an edge are exact up to the third.
    """
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    piece = lengths.sum() / CELLS
    fractions, weights = [], []
    for length in lengths:
        count = math.ceil(length / piece)
        centres = (np.arange(count) + 0.5) / count
        offset = 0.5 / (count * math.sqrt(3.0))
        fractions.append(np.concatenate([centres - offset, centres + offset]))
        weights.append(np.full(2 * count, length / (2 * count)))
    repeats = [len(f) for f in fractions]
    along = np.concatenate(fractions)[:, None]
    points = np.repeat(outline, repeats, axis=0) + along * np.repeat(edges, repeats, axis=0)
    return _normalised(points, np.concatenate(weights))


def _area_support(outline: Outline) -> Support:
    """Returns an even pressure over the area.

    The area is cut into triangles, each triangle into equal pieces, and each piece has three points. The
    second moments of the pressure are exact.
    """
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.polygons(outline)))
    triangles = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]  # (T, 3, 2)
    total = shapely.area(parts).sum()
    points, weights = [], []
    for triangle, size in zip(triangles, shapely.area(parts), strict=True):
        count = math.ceil(math.sqrt(CELLS * size / total))
        barycentric = _split_triangle(count)
        points.append(barycentric @ triangle)
        weights.append(np.full(len(barycentric), size / len(barycentric)))
    return _normalised(np.concatenate(points), np.concatenate(weights))


def _split_triangle(count: int) -> Array:
    """Barycentric coordinates (3 count^2, 3) of three points in each of count^2 equal triangles."""
    i, j = (index.ravel() for index in np.mgrid[:count, :count])
    upright = np.column_stack([i, j])[i + j < count]
    corners = np.array([[0, 0], [1, 0], [0, 1]])
    inverted = upright[upright.sum(axis=1) < count - 1]
    # (count^2, 3, 2)
    small = np.concatenate([upright[:, None] + corners, inverted[:, None] + 1 - corners]) / count
    # The rule of degree 2 with points at (2/3, 1/6, 1/6) and its permutations.
    rule = np.full((3, 3), 1.0 / 6.0) + 0.5 * np.eye(3)
    inner = (rule @ small).reshape(-1, 2)
    return np.column_stack([1.0 - inner.sum(axis=1), inner])


def _normalised(points: Array, weights: Array) -> Support:
    weights = weights / weights.sum()
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights
