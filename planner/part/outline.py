"""The outline of a part: a simple polygon, counter-clockwise, in mm, with its area centroid at the origin.

Arrays of vertices have shape (N, 2); the closing edge runs from the last vertex to the first.
"""

import math
import re
from typing import NamedTuple, TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike

from planner.arrays import Array
from runtime.shell.errors import InputError

Outline: TypeAlias = Array

MOST_VERTICES = 2000
"""Most vertices of an outline: checks of symmetry take quadratic time, which no budget interrupts."""
REPEAT_MM = 1e-6  # Largest distance of two vertices that count as one vertex written twice

CENTRED = 1e-6
"""Largest distance of a centred outline's centroid from the origin, as a fraction of the outline's reach."""


class Canonical(NamedTuple):
    """A checked outline and its shift from the drawing."""

    outline_mm: Outline  # (N, 2), counter-clockwise, area centroid at the origin, read-only
    shift_mm: Array  # (2,), added to the drawing's coordinates


def canonical(points: ArrayLike) -> Canonical:
    """Checks an outline (N, 2) as drawn [mm], makes it counter-clockwise and centres its area centroid.

    The first vertex stays the first.

    Raises:
        InputError: fewer than 3 vertices, a number that is not finite, a vertex written twice, or a
            boundary that crosses or touches itself.
    """
    vertices = _vertices(points)
    if area(vertices) < 0.0:
        vertices = np.concatenate([vertices[:1], vertices[:0:-1]])
    shift = -centroid(vertices)
    # Adding 0.0 turns -0.0 into 0.0, so that equal outlines have equal text.
    outline = vertices + shift + 0.0
    outline.setflags(write=False)
    shift.setflags(write=False)
    return Canonical(outline, shift)


def checked(points: ArrayLike) -> Outline:
    """Checks that an outline (N, 2) [mm] is canonical, and returns a read-only copy with the same numbers.

    Raises:
        InputError: see `canonical`; or the outline is clockwise or off centre.
    """
    vertices = _vertices(points)
    if area(vertices) < 0.0:
        raise InputError("outline runs clockwise; list its vertices counter-clockwise")
    offset = float(np.hypot(*centroid(vertices)))
    if offset > CENTRED * reach(vertices):
        problem = f"area centroid is {offset:.6g} mm from the origin; move the outline there"
        raise InputError(problem)
    vertices.setflags(write=False)
    return vertices


def area(outline: Outline) -> float:
    """The enclosed area in mm^2, positive for a counter-clockwise outline."""
    return 0.5 * math.fsum(_cross_terms(outline - outline[0]))


def centroid(outline: Outline) -> Array:
    """The area centroid (2,) in mm."""
    # Relative to a vertex, so that an outline drawn far from the origin loses no digits;
    # fsum, so that the text of a job does not depend on the machine's order of summation.
    local = outline - outline[0]
    following = np.roll(local, -1, axis=0)
    cross = _cross_terms(local)
    moments = (local + following) * cross[:, None]
    scale = 3.0 * math.fsum(cross)
    x, y = outline[0]
    return np.array([x + math.fsum(moments[:, 0]) / scale, y + math.fsum(moments[:, 1]) / scale])


def radius_of_gyration(outline: Outline) -> float:
    """The radius of gyration of the enclosed area about the origin, mm.

    This is the rho of the paper's metric (eq. 9) and of its normalised pose (V.B): a property of the part
    alone, independent of the pressure. For a rectangle a x b it is sqrt((a^2 + b^2) / 12).
    """
    following = np.roll(outline, -1, axis=0)
    squares = (outline**2 + outline * following + following**2).sum(axis=1)
    cross = _cross_terms(outline)
    return math.sqrt(math.fsum(cross * squares) / (6.0 * math.fsum(cross)))


def reach(outline: Outline) -> float:
    """Largest distance of a vertex from the origin, mm."""
    return float(np.max(np.hypot(*outline.T)))


def width(outline: Outline, angle: float) -> float:
    """The extent of the outline along the direction at `angle` (rad), mm."""
    return float(np.ptp(outline @ np.array([math.cos(angle), math.sin(angle)])))


def min_width(outline: Outline) -> float:
    """The least extent over all directions, mm: the narrowest opening of jaws between which the outline fits.

    The minima lie where one jaw is flush on an edge of the convex hull (Goldberg's diameter function, the
    paper's reference [12]).
    """
    hull = convex_hull(outline)
    along = _normals(hull) @ hull.T  # (edges, vertices)
    return float((along.max(axis=1) - along.min(axis=1)).min())


def convex_hull(outline: Outline) -> Outline:
    """The vertices (M, 2) of the convex hull, counter-clockwise, mm."""
    hull = shapely.orient_polygons(shapely.convex_hull(shapely.multipoints(outline)))
    return np.asarray(shapely.get_coordinates(hull)[:-1], dtype=np.float64)


def _cross_terms(outline: Outline) -> Array:
    """x_i y_(i+1) - x_(i+1) y_i for each edge (N,): twice the area of the edge's triangle with the origin."""
    following = np.roll(outline, -1, axis=0)
    return np.asarray(outline[:, 0] * following[:, 1] - following[:, 0] * outline[:, 1])


def _normals(outline: Outline) -> Array:
    """The outward unit normals of the edges (N, 2)."""
    edges = np.roll(outline, -1, axis=0) - outline
    return np.asarray(np.column_stack([edges[:, 1], -edges[:, 0]]) / np.hypot(*edges.T)[:, None])


def _vertices(points: ArrayLike) -> Outline:
    try:
        vertices = np.array(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("outline is not a list of [x, y] pairs of numbers") from error
    if vertices.ndim != 2 or vertices.shape[1] != 2:
        raise InputError("outline is not a list of [x, y] pairs of numbers")
    if len(vertices) < 3:
        raise InputError(f"outline has {len(vertices)} vertices; give at least 3")
    if not np.isfinite(vertices).all():
        index = int(np.argmin(np.isfinite(vertices).all(axis=1)))
        raise InputError(f"vertex {index + 1} is not finite; give plain numbers in mm")
    _check_distinct(vertices)
    _check_simple(vertices)
    return vertices


def _check_distinct(vertices: Outline) -> None:
    tree = shapely.STRtree(shapely.points(vertices))
    pairs = tree.query(tree.geometries, predicate="dwithin", distance=REPEAT_MM)
    repeated = pairs[:, pairs[0] < pairs[1]]
    if repeated.shape[1] == 0:
        return
    first, second = sorted(map(tuple, repeated.T.tolist()))[0]
    advice = "drop one of them"
    if (first, second) == (0, len(vertices) - 1):
        advice = "drop the last one, the outline closes by itself"
    x, y = vertices[first]
    problem = f"vertices {first + 1} and {second + 1} are the same point ({x:g}, {y:g}); {advice}"
    raise InputError(problem)


def _check_simple(vertices: Outline) -> None:
    if shapely.area(shapely.convex_hull(shapely.multipoints(vertices))) <= REPEAT_MM**2:
        raise InputError("outline encloses no area; its vertices lie on one line")
    reason = shapely.is_valid_reason(shapely.polygons(vertices))
    if reason == "Valid Geometry":
        return
    place = re.search(r"\[(\S+) (\S+)\]", reason)
    where = f" at ({float(place[1]):g}, {float(place[2]):g})" if place else ""
    verb = "touches" if reason.startswith("Ring Self") else "crosses"
    raise InputError(f"outline {verb} itself{where}; list the vertices in order around the part")


def offsets(outline: Outline) -> Array:
    """Displacement (N, 2) of each vertex if all edges move outwards by 1 mm."""
    after = _normals(outline)
    before = np.roll(after, 1, axis=0)
    return np.asarray((before + after) / (1.0 + (before * after).sum(axis=1))[:, None])


def grown(outline: Outline, mm: float) -> Outline:
    """The outline with all edges moved outwards by `mm`, with its new centroid at the origin."""
    larger = outline + mm * offsets(outline)
    return np.asarray(larger - centroid(larger))


def simplified(outline: Outline, tolerance_mm: float) -> Outline:
    """Removes vertices that lie within a tolerance of the remaining outline (Douglas and Peucker 1973).

    The result does not cross itself. Each of the two outlines lies within the tolerance of the other. A
    tolerance of 0 removes collinear vertices only.
    """
    ring = shapely.Polygon(outline).simplify(tolerance_mm, preserve_topology=True)
    result: Outline = shapely.get_coordinates(shapely.orient_polygons(ring))[:-1]
    result.setflags(write=False)
    return result


LEAST_TURN_DEG = 0.05  # turn of a rectangle below which it counts as parallel to the axes


class Rectangle(NamedTuple):
    """A rectangle about an outline."""

    length_mm: float  # its longer side
    width_mm: float  # its shorter side
    turn_deg: float  # angle of the longer side from x, in (-90, 90]

    def text(self) -> str:
        """Describes the rectangle for people: the sides, and the turn if it is not parallel to the axes."""
        turned = min(abs(self.turn_deg), 90.0 - abs(self.turn_deg)) > LEAST_TURN_DEG
        sides = f"{self.length_mm:.1f} x {self.width_mm:.1f} mm"
        return sides + (f", turned by {self.turn_deg:.3g} degrees in the drawing" if turned else "")


def smallest_rectangle(outline: Outline) -> Rectangle:
    """The rectangle of least area about an outline (N, 2) [mm]."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.multipoints(outline)))[:3]
    sides = np.diff(corners, axis=0)
    (dx, dy), (length, width) = sides[0], np.hypot(*sides.T)
    if length < width:
        (dx, dy), length, width = sides[1], width, length
    turn = -math.remainder(-math.degrees(math.atan2(dy, dx)), 180.0)
    return Rectangle(float(length), float(width), turn)
