"""From shapes to contours: strokes joined, copies and holes told apart, one contour chosen."""

import math
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
NEARLY = 0.1  # of its size: an outline that is open by no more was meant to be closed


SHEETS_MM = ((841, 1189), (594, 841), (420, 594), (297, 420), (210, 297), (148, 210))  # ISO 216, A0 to A5
MARGINS_MM = 50.0  # both sides together: 20 mm to file it and 10 mm (ISO 5457), and some more
SHEET_SLACK_MM = 0.5


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
    rings = [ring for ring in (*pieces.rings, *joined) if len(ring) > 2 and _hull(ring).area > join_mm**2]
    if not rings or _around(loose, rings):
        raise _no_contour(loose, where)
    if len(rings) > MOST:
        raise too_much(where, f"has more than {MOST} contours")
    notes = list(pieces.notes)
    if loose:
        gap = _gap(loose)
        what = f"the narrowest gap, {gap.width_mm:.3g} mm, is at ({gap.x:.4g}, {gap.y:.4g}) mm"
        notes.append(f"{what}; {len(loose)} open lines ignored")
    distinct = _without_copies(rings, join_mm)
    if len(distinct) < len(rings):
        notes.append(f"{len(rings) - len(distinct)} contours drawn twice, taken once")
    frames = [k for k, ring in enumerate(distinct) if _is_frame(ring, distinct)]
    for k in frames:
        width, height = np.ptp(distinct[k], axis=0)
        notes.append(f"the frame of a sheet, {width:.4g} x {height:.4g} mm, left out")
    return _nested([ring for k, ring in enumerate(distinct) if k not in frames]), notes


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


def holes_of(contour: Contour, found: list[Contour]) -> list[Array]:
    """The inner contours (n, 2) [mm] that lie inside a contour."""
    face = _face(contour.points)
    return [o.points for o in found if o is not contour and face.contains(_face(o.points))]


def _face(ring: Array) -> shapely.Geometry:
    return shapely.make_valid(shapely.Polygon(ring))


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


def _hull(points: Array) -> shapely.Geometry:
    return shapely.convex_hull(shapely.multipoints(points))


def _is_frame(ring: Array, rings: list[Array]) -> bool:
    """Whether a ring is the border of an ISO 216 sheet, or of its margins, about at least one other ring.

    What no gripper takes is no part: the shorter side of the smallest such border is that of A5 less margins.
    """
    low, high = ring.min(axis=0), ring.max(axis=0)
    sides = np.sort(high - low)
    box = shapely.box(*low, *high)
    if abs(float(shapely.Polygon(ring).area) - box.area) > SHEET_SLACK_MM * float(sides.sum()):
        return False
    fits = any(
        np.all((sides <= np.array(sheet) + SHEET_SLACK_MM) & (sides >= np.array(sheet) - MARGINS_MM))
        for sheet in SHEETS_MM
    )
    return fits and any(
        other is not ring and box.contains_properly(shapely.multipoints(other)) for other in rings
    )


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
    faces = [_face(ring) for ring in rings]
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


def _no_contour(loose: list[Array], where: str) -> OutlineError:
    if not loose:
        return OutlineError("holds no closed contour; draw the part's outline as one", where=where)
    gap = _gap(loose)
    problem = (
        f"the contour is open at ({gap.x:.4g}, {gap.y:.4g}) mm, where the nearest end is "
        f"{gap.width_mm:.4g} mm away; close it in the drawing"
    )
    return OutlineError(problem, where=where)


def _around(loose: list[Array], rings: list[Array]) -> bool:
    """Whether open lines that nearly close go around all rings: an open outline, and closed holes in it."""
    if not loose:
        return False
    hull = _hull(np.concatenate(loose))
    nearly = _gap(loose).width_mm <= NEARLY * math.sqrt(hull.area)
    return nearly and all(hull.contains_properly(shapely.multipoints(ring)) for ring in rings)


class Gap(NamedTuple):
    """Where a contour is open."""

    x: float  # [mm]
    y: float  # [mm]
    width_mm: float  # to the nearest end of a line


def _gap(lines: list[Array]) -> Gap:
    """The smallest distance between ends of lines that are put together where they meet."""
    merged = shapely.line_merge(shapely.multilinestrings([shapely.linestrings(line) for line in lines]))
    chains = [shapely.get_coordinates(chain) for chain in shapely.get_parts(merged)]
    ends = np.array([chain[k] for chain in chains for k in (0, -1)])
    gaps = cKDTree(ends).query(ends, k=2)[0][:, 1]
    apart = np.where(gaps > 0.0, gaps, np.inf)  # where three lines meet, two ends have no gap
    k = int(np.argmin(apart)) if np.isfinite(apart).any() else 0
    return Gap(float(ends[k, 0]), float(ends[k, 1]), float(gaps[k]))
