"""Contours from the shapes of a drawing: joins strokes, recognises copies and holes, chooses one contour."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from planner.arrays import Array
from planner.part.importers import noding, seams
from planner.part.importers.pieces import Lost, Pieces, place, too_much
from planner.part.importers.seams import Drawn
from runtime.shell.errors import InputError, UsageError

LISTED = 12  # most contours that a message describes
MOST = 2000  # Most contours of one drawing
NEARLY = 0.1  # largest gap of an outline that counts as nearly closed, as a share of its size
LARGER_MM = 0.1  # distance that an unread shape must extend beyond a contour to surround it

# ISO 216, A0 to A5
SHEETS_MM = np.array([(841, 1189), (594, 841), (420, 594), (297, 420), (210, 297), (148, 210)])
MARGINS_MM = 50.0  # largest margins of two sides together
# By how much the margin on the side for filing exceeds the others: not, 20 over 10 mm (ISO 5457), 20 over 5
# (GOST 2.301), 25 over 5.
FILING_MM = np.array([0.0, 10.0, 15.0, 20.0])
SHEET_SLACK_MM = 0.5


class Contour(NamedTuple):
    """A closed curve of a drawing."""

    points: Array  # (n, 2) [mm], not closed
    note: str = ""  # how it was joined from several faces; "" for a single face
    ambiguity: str = ""  # why and where its lines may bound another contour, and what to do; or ""
    area_mm2: float = 0.0  # enclosed area
    holes: int = 0  # how many contours lie inside it
    outer: bool = True  # whether it lies inside no other contour


def contours(pieces: Pieces, join_mm: float) -> tuple[list[Contour], list[str]]:
    """Finds all contours of a drawing.

    Closes gaps of up to `join_mm` at ends of strokes, and cuts lines where they cross or overlap. Closed
    regions that share an edge form one contour.

    Returns:
        The contours, outer before inner ones and larger before smaller ones, and notes on the drawing.

    Raises:
        InputError: there is no contour, and the message says where the drawing is open; or there are too
            many contours.
    """
    alone, drawn = _sorted(pieces, join_mm)
    origin = drawn.origin
    bounded = noding.regions(drawn.lines, join_mm)
    joined = [
        Contour(region.ring, *seams.meaning(region, bounded.loose, drawn, join_mm))
        for region in bounded.regions
    ]
    rings = [each for each in (*map(Contour, alone), *joined) if _is_wide(each.points, join_mm)]
    if not rings or _around(bounded.loose, [ring.points for ring in rings]):
        raise _no_contour(bounded.loose, origin, pieces.lost)
    if len(rings) > MOST:
        raise too_much(f"has more than {MOST} contours")
    notes = list(pieces.notes)
    if bounded.repeated_mm > join_mm:
        notes.append(f"{bounded.repeated_mm:.4g} mm of lines drawn twice, taken once")
    if bounded.loose:
        gap = _gap(bounded.loose)
        what = f"the narrowest gap, {gap.width_mm:.3g} mm, is at {place(gap.point + origin)} mm"
        notes.append(f"{what}; {len(bounded.loose)} open lines ignored")
    distinct = _without_copies(rings, join_mm)
    if len(distinct) < len(rings):
        notes.append(f"{len(rings) - len(distinct)} contours drawn twice, taken once")
    frames = [k for k, ring in enumerate(distinct) if _is_frame(ring.points, distinct)]
    for k in frames:
        width, height = np.ptp(distinct[k].points, axis=0)
        notes.append(f"the frame of a sheet, {width:.4g} x {height:.4g} mm, left out")
    nested = _nested([ring for k, ring in enumerate(distinct) if k not in frames])
    return [contour._replace(points=contour.points + origin) for contour in nested], notes


def choose(
    candidates: list[Contour], number: int | None, lost: Sequence[Lost]
) -> tuple[Contour, list[str]]:
    """Chooses a contour by its number, and returns it with notes on the choice.

    Numbers count from 1; None chooses the only outer contour.

    Raises:
        UsageError: there is no such contour, or the number is None and there are several outer contours. The
            message lists the contours.
        InputError: one of the `lost` shapes, which were not read, may be the outline; or the chosen contour
            is ambiguous (`seams.meaning`).
    """
    outer = [contour for contour in candidates if contour.outer]
    listed = listing(candidates)
    for shape in lost:
        if shape.box is None or any(_exceeds(shape.box, contour) for contour in outer):
            raise _missing(shape)
    if number is None and len(outer) > 1:
        raise UsageError(f"has {len(outer)} contours; choose with --contour N: {listed}")
    if number is not None and not 1 <= number <= len(candidates):
        choice = f"choose with --contour 1 to {len(candidates)}: {listed}"
        raise UsageError(f"has no contour {number}; {choice}")
    contour = candidates[(number or 1) - 1]
    if contour.ambiguity:
        raise InputError(contour.ambiguity)
    notes = [contour.note] if contour.note else []
    if contour.holes:
        what = "contour" if contour.holes == 1 else "contours"
        notes.append(f"{contour.holes} inner {what} (holes) ignored")
    if len(candidates) > 1:
        notes.append(f"contour {number or 1} of {len(candidates)} taken: {listed}")
    return contour, notes


def holes_of(contour: Contour, contours: list[Contour]) -> list[Array]:
    """The contours, each (n, 2) [mm], that lie inside `contour`."""
    face = noding.face(contour.points)
    return [o.points for o in contours if o is not contour and face.contains(noding.face(o.points))]


def listing(contours: list[Contour]) -> str:
    """Describes the contours in one line: number, extent, kind."""
    lines = []
    for number, contour in enumerate(contours[:LISTED], 1):
        width, height = np.ptp(contour.points, axis=0)
        kind = "" if contour.outer else " (inner)"
        lines.append(f"{number}: {width:.4g} x {height:.4g} mm{kind}")
    more = len(contours) - LISTED
    return "; ".join(lines) + (f"; and {more} more" if more > 0 else "")


def _sorted(pieces: Pieces, join_mm: float) -> tuple[list[Array], Drawn]:
    """Returns the isolated rings, each (n, 2), and all other lines, relative to a local origin.

    A ring that does not cross itself is isolated if no other line comes within `join_mm` of it. A ring that
    crosses itself is isolated if its lines bound several regions or none; it is refused later, if it is
    chosen as the outline. If its lines bound exactly one region, they belong to the other lines.
    """
    curves = [*pieces.rings, *pieces.strokes]
    if not curves:
        return [], Drawn([], [], np.zeros(2), shapely.STRtree([]))
    origin = np.round(curves[0][0])
    lines = [curve - origin for curve in curves]
    count = len(pieces.rings)
    lines[:count] = [np.concatenate([ring, ring[:1]]) for ring in lines[:count]]
    strings = [shapely.LineString(line) for line in lines]
    near = shapely.STRtree(strings).query(strings, predicate="dwithin", distance=join_mm)
    neighbours = np.bincount(near[0], minlength=len(lines)) - 1
    apart = []
    for k in range(count):
        if strings[k].is_simple:
            isolated = not neighbours[k]
        else:
            isolated = len(noding.regions([lines[k]], join_mm).regions) != 1
        if isolated:
            apart.append(k)
    rest = sorted(set(range(len(lines))) - set(apart))
    tree = shapely.STRtree([strings[k] for k in rest])
    drawn = Drawn([lines[k] for k in rest], [pieces.layers[k] for k in rest], origin, tree)
    return [lines[k][:-1] for k in apart], drawn


def _is_wide(ring: Array, join_mm: float) -> bool:
    """Whether a ring encloses more than a line that was drawn there and back.

    A ring of length s is such a line if its area is at most 0.5 s `join_mm`: its two halves are then about
    `join_mm` apart, or less.
    """
    least = 0.5 * join_mm * float(shapely.LinearRing(ring).length) if len(ring) > 2 else 0.0
    return len(ring) > 2 and _hull(ring).area > least and float(noding.face(ring).area) > least


def _hull(points: Array) -> shapely.Geometry:
    return shapely.convex_hull(shapely.multipoints(points))


def _is_frame(ring: Array, others: Sequence[Contour]) -> bool:
    """Whether a ring is the border of an ISO 216 sheet, with or without margins, and surrounds another ring.

    Margins of all sides are equal, but for that of the side for filing (`FILING_MM`).
    """
    low, high = ring.min(axis=0), ring.max(axis=0)
    sides = np.sort(high - low)
    box = shapely.box(*low, *high)
    if abs(float(shapely.Polygon(ring).area) - box.area) > SHEET_SLACK_MM * float(sides.sum()):
        return False
    margins = SHEETS_MM - sides
    fits = ((margins >= -SHEET_SLACK_MM) & (margins <= MARGINS_MM)).all(axis=1)
    filing = np.abs(margins[:, :1] - margins[:, 1:])
    usual = (np.abs(filing - FILING_MM) <= SHEET_SLACK_MM).any(axis=1)
    return bool((fits & usual).any()) and any(
        other.points is not ring and box.contains_properly(shapely.multipoints(other.points))
        for other in others
    )


def _without_copies(rings: list[Contour], tolerance_mm: float) -> list[Contour]:
    """Removes rings that repeat an earlier ring to within the tolerance."""
    lines = [shapely.LinearRing(ring.points) for ring in rings]
    boxes = shapely.bounds(lines)
    kept: list[int] = []
    for k, line in enumerate(lines):
        near = np.abs(boxes[kept] - boxes[k]).max(axis=1, initial=0.0) <= tolerance_mm
        alike = [lines[kept[j]] for j in np.flatnonzero(near)]
        if not any(line.hausdorff_distance(other) <= tolerance_mm for other in alike):
            kept.append(k)
    return [rings[k] for k in kept]


def _nested(rings: list[Contour]) -> list[Contour]:
    """Returns the rings with their areas, their numbers of holes, and whether they lie inside no other ring.

    Outer rings come before inner ones, and larger rings before smaller ones.
    """
    faces = [noding.face(ring.points) for ring in rings]
    tree = shapely.STRtree(faces)
    inner, outer = tree.query(faces, predicate="within")
    proper = inner != outer
    inner, outer = inner[proper], outer[proper]
    depth = np.bincount(inner, minlength=len(rings))
    holes = np.bincount(outer, minlength=len(rings))
    results = [
        ring._replace(area_mm2=float(face.area), holes=int(holes[k]), outer=not depth[k])
        for k, (ring, face) in enumerate(zip(rings, faces, strict=True))
    ]
    return sorted(results, key=lambda contour: (not contour.outer, -contour.area_mm2))


def _missing(lost: Lost) -> InputError:
    problem = f"the outline may be missing: {lost.what}; repair or delete it in the drawing"
    return InputError(problem)


def _no_contour(loose: list[Array], origin: Array, lost: Sequence[Lost]) -> InputError:
    if not loose and lost:
        return _missing(lost[0])
    if not loose:
        return InputError("holds no closed contour; draw the part's outline as one")
    gap = _gap(loose)
    end = f"where the nearest end is {gap.width_mm:.4g} mm away"
    problem = f"the contour is open at {place(gap.point + origin)} mm, {end}"
    return InputError(f"{problem}; close it in the drawing")


def _around(loose: list[Array], rings: list[Array]) -> bool:
    """Whether open lines surround all rings, as an outline that was left open surrounds its holes.

    Lines surround what their convex hull contains. The hull of each single chain counts, however far the ends
    of the chain are apart. The hull of all lines together counts only if two ends of chains nearly meet.
    """
    if not loose:
        return False
    hulls = [_hull(chain) for chain in noding.chains(loose)]
    every = _hull(np.concatenate(loose))
    if _gap(loose).width_mm <= NEARLY * math.sqrt(every.area):
        hulls.append(every)
    points = shapely.multipoints(np.concatenate(rings))
    return any(hull.contains_properly(points) for hull in hulls)


class Gap(NamedTuple):
    """The place where a contour is open."""

    point: Array  # (2,) an end of a line [mm]
    width_mm: float  # distance to the nearest other end


def _gap(lines: list[Array]) -> Gap:
    """The narrowest gap between the ends of chains of lines."""
    ends = np.array([chain[k] for chain in noding.chains(lines) for k in (0, -1)])
    gaps = cKDTree(ends).query(ends, k=2)[0][:, 1]
    apart = np.where(gaps > 0.0, gaps, np.inf)  # where three lines meet, two ends have no gap
    k = int(np.argmin(apart)) if np.isfinite(apart).any() else 0
    return Gap(ends[k], float(gaps[k]))


def _exceeds(box: Array, contour: Contour) -> bool:
    """Whether a box contains a contour and extends beyond it."""
    low, high = contour.points.min(axis=0), contour.points.max(axis=0)
    beyond = np.concatenate([low - box[0], box[1] - high])
    return bool((beyond > -LARGER_MM).all() and (beyond > LARGER_MM).any())
