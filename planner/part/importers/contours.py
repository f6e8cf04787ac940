"""From shapes to contours: strokes joined, copies and holes told apart, one contour chosen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from planner.arrays import Array
from planner.errors import OutlineError, UsageError
from planner.part.importers.pieces import Pieces, too_much

LISTED = 12
MOST = 2000  # Most contours of one drawing


class Contour(NamedTuple):
    """A closed curve of a drawing."""

    points: Array  # (n, 2) [mm], not closed
    area_mm2: float  # what it encloses
    holes: int  # how many contours lie inside it
    outer: bool  # whether it lies inside none


def contours(pieces: Pieces, join_mm: float, where: str) -> tuple[list[Contour], list[str]]:
    """All contours of a drawing, the outer ones first, the larger before the smaller; and notes.

    Ends of strokes within `join_mm` of each other are one point.

    Raises:
        OutlineError: there is none; says where the drawing is open.
    """
    joined, loose = _joined(pieces.strokes, join_mm)
    rings = [ring for ring in (*pieces.rings, *joined) if _encloses(ring, join_mm)]
    if not rings:
        raise _no_contour(pieces, loose, where)
    if len(rings) > MOST:
        raise too_much(where, f"has more than {MOST} contours")
    notes = list(pieces.notes)
    if loose:
        notes.append(f"{len(loose)} open lines ignored")
    distinct = _without_copies(rings, join_mm)
    if len(distinct) < len(rings):
        notes.append(f"{len(rings) - len(distinct)} contours drawn twice, taken once")
    return _nested(distinct), notes


def choose(found: list[Contour], number: int | None, where: str) -> tuple[Contour, list[str]]:
    """The contour asked for, or the only outer one; and notes.

    Raises:
        UsageError: there is no such contour, or there are several to choose from; lists them.
    """
    outer = [contour for contour in found if contour.outer]
    if number is None and len(outer) > 1:
        raise UsageError(f"{where}: has {len(outer)} contours; choose with --contour N: {listing(found)}")
    if number is not None and not 1 <= number <= len(found):
        raise UsageError(
            f"{where}: has no contour {number}; choose with --contour 1 to {len(found)}: {listing(found)}"
        )
    contour = found[(number or 1) - 1]
    notes = []
    if contour.holes:
        what = "contour" if contour.holes == 1 else "contours"
        notes.append(f"{contour.holes} inner {what} (holes) ignored")
    if len(found) > 1:
        notes.append(f"contour {number or 1} of {len(found)} taken: {listing(found)}")
    return contour, notes


def listing(found: list[Contour]) -> str:
    """The contours in one line: number, extent, what they are."""
    told = []
    for number, contour in enumerate(found[:LISTED], 1):
        width, height = np.ptp(contour.points, axis=0)
        told.append(f"{number}: {width:.4g} x {height:.4g} mm{'' if contour.outer else ' (inner)'}")
    more = len(found) - LISTED
    return "; ".join(told) + (f"; and {more} more" if more > 0 else "")


def _joined(strokes: list[Array], join_mm: float) -> tuple[list[Array], list[Array]]:
    """Strokes put together to rings, and those that belong to none.

    Ends within `join_mm` of each other become one point; then GEOS finds the faces that the strokes bound.
    """
    if not strokes:
        return [], []
    ends = np.array([stroke[k] for stroke in strokes for k in (0, -1)])
    names = _clusters(ends, join_mm)
    middles = np.array([ends[names == name].mean(axis=0) for name in range(names.max() + 1)])
    lines = []
    for k, stroke in enumerate(strokes):
        line = stroke.copy()
        line[0], line[-1] = middles[names[2 * k]], middles[names[2 * k + 1]]
        if len(np.unique(line, axis=0)) > 1:
            lines.append(shapely.LineString(line))
    faces, cuts, dangles, _ = shapely.polygonize_full(lines)
    rings = [shapely.get_coordinates(face.exterior)[:-1] for face in faces.geoms]
    return rings, [shapely.get_coordinates(line) for line in (*cuts.geoms, *dangles.geoms)]


def _clusters(points: Array, radius: float) -> Array:
    """A number for each point (n,); points that neighbours of `radius` connect have the same one."""
    cells, member = np.unique(np.rint(points / (0.1 * radius)), axis=0, return_inverse=True)
    pairs = cKDTree(cells).query_pairs(10.0, output_type="ndarray")  # crowds on one point are one cell
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    return np.asarray(connected_components(links, directed=False)[1][member.ravel()])


def _encloses(ring: Array, join_mm: float) -> bool:
    return len(ring) > 2 and float(shapely.multipoints(ring).convex_hull.area) > join_mm**2


def _without_copies(rings: list[Array], tolerance_mm: float) -> list[Array]:
    """The rings without those that lie upon an earlier one."""
    lines = [shapely.LinearRing(ring) for ring in rings]
    boxes = shapely.bounds(lines)
    kept: list[int] = []
    for k, line in enumerate(lines):
        alike = np.flatnonzero(np.abs(boxes[kept] - boxes[k]).max(axis=1, initial=0.0) <= tolerance_mm)
        if not any(line.hausdorff_distance(lines[kept[j]]) <= tolerance_mm for j in alike):
            kept.append(k)
    return [rings[k] for k in kept]


def _nested(rings: list[Array]) -> list[Contour]:
    """Which ring lies inside which: by a point of each, since contours of a part do not cross."""
    faces = [shapely.make_valid(shapely.Polygon(ring)) for ring in rings]
    tree = shapely.STRtree(faces)
    inner, outer = tree.query(faces, predicate="within")
    proper = inner != outer
    inner, outer = inner[proper], outer[proper]
    depth, holes = np.bincount(inner, minlength=len(rings)), np.bincount(outer, minlength=len(rings))
    found = [
        Contour(ring, float(face.area), int(holes[k]), not depth[k])
        for k, (ring, face) in enumerate(zip(rings, faces, strict=True))
    ]
    return sorted(found, key=lambda contour: (not contour.outer, -contour.area_mm2))


def _no_contour(pieces: Pieces, loose: list[Array], where: str) -> OutlineError:
    if not loose:
        return OutlineError("holds no closed contour; draw the part's outline as one", where=where)
    ends = np.array([line[k] for line in pieces.strokes for k in (0, -1)])
    gaps = cKDTree(ends).query(ends, k=2)[0][:, 1] if len(ends) > 1 else np.zeros(1)
    k = int(np.argmax(gaps))
    x, y = ends[k]
    problem = (
        f"the contour is open at ({x:.4g}, {y:.4g}) mm, where the nearest end is {gaps[k]:.4g} mm away; "
        "close it in the drawing"
    )
    return OutlineError(problem, where=where)
