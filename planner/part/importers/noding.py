"""Finds the regions that lines bound, even where the lines meet, cross or overlap.

GEOS cuts the lines where they meet, after rounding to a grid (snap rounding), and finds the faces that they
bound (`polygonize`). Faces that share an edge are joined to one region.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from shapely.ops import substring

from planner.arrays import Array, BoolArray, IntArray

GRID_MM = 1e-6  # Grid of the snap rounding: smaller differences are rounding errors of the file
BESIDE_MM = 1e-5  # Largest distance of a rounded line from the original


class Region(NamedTuple):
    """One face, or the union of several faces that share edges."""

    ring: Array  # (n, 2) outer boundary, not closed [mm]
    seams: list[Array]  # lines (n, 2) that two faces of the region share [mm]


def face(ring: Array) -> shapely.Geometry:
    """The area that a ring (n, 2) encloses: several polygons if the ring crosses itself."""
    return shapely.make_valid(shapely.Polygon(ring))


class Regions(NamedTuple):
    """The regions that lines bound."""

    regions: list[Region]
    loose: list[Array]  # lines (n, 2) that bound no face [mm]
    repeated_mm: float  # length of the overlapping lines


class _Ends(NamedTuple):
    """Free ends: ends of chains that meet no other line."""

    points: Array  # (n, 2)
    chain: IntArray  # (n,) index of the chain that ends there
    last: BoolArray  # (n,) whether the end is the chain's last point


def regions(lines: Sequence[Array], join_mm: float) -> Regions:
    """Finds the regions that lines (n, 2) [mm] bound; closes gaps of up to `join_mm` at ends of lines.

    A face thinner than `join_mm` counts as the space between two copies of one line: it is joined to its
    neighbours without a seam.
    """
    if not lines:
        return Regions([], [], 0.0)
    drawn = [shapely.LineString(line) for line in lines]
    noded = shapely.union_all(drawn, grid_size=GRID_MM)
    repeated_mm = float(shapely.length(drawn).sum() - noded.length)
    faces, cuts, dangles, _ = shapely.polygonize_full([_bridged(noded, join_mm)])
    polygons = shapely.get_parts(faces)
    loose = np.concatenate([shapely.get_parts(cuts), shapely.get_parts(dangles)])
    loose = loose[shapely.length(loose) > join_mm]
    if not len(polygons):
        return Regions([], _coordinates(loose), repeated_mm)
    around = shapely.length(shapely.get_exterior_ring(polygons))
    thin = shapely.area(polygons) <= 0.5 * join_mm * around
    repeated_mm += 0.5 * float(shapely.length(polygons[thin]).sum())
    return Regions(_joined(polygons, thin), _coordinates(loose), repeated_mm)


def chains(lines: Sequence[Array] | Array) -> list[Array]:
    """Merges lines (n, 2) to chains (m, 2), at the points where exactly two lines meet."""
    drawn = shapely.geometrycollections([shapely.linestrings(line) for line in lines])
    return _coordinates(shapely.get_parts(shapely.line_merge(drawn)))


def _coordinates(lines: Array) -> list[Array]:
    return [shapely.get_coordinates(line) for line in lines]


def _bridged(noded: shapely.Geometry, join_mm: float) -> shapely.Geometry:
    """Adds bridges to lines; a bridge closes a gap of up to `join_mm` at a free end of a line.

    `noded` are the lines, cut where they meet.
    """
    chains = shapely.get_parts(shapely.line_merge(noded))
    ends = _free_ends(chains, join_mm)
    if not len(ends.points):
        return noded
    paired, bridges = _pairs(chains, ends, join_mm)
    tree = shapely.STRtree(chains)
    for k in np.flatnonzero(~paired):
        if (bridge := _to_nearest(tree, ends, int(k), join_mm)) is not None:
            bridges.append(bridge)
    return shapely.union_all([*chains, *bridges], grid_size=GRID_MM) if bridges else noded


def _free_ends(chains: Array, join_mm: float) -> _Ends:
    """The ends of chains at which no other chain ends.

    If a chain of up to `join_mm` has one free end, the chain is an overshoot, and this end is left out.
    """
    points = shapely.get_coordinates([shapely.get_point(chains, index) for index in (0, -1)])
    chain = np.tile(np.arange(len(chains)), 2)
    last = np.repeat([False, True], len(chains))
    _, name, count = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    free = count[name.ravel()] == 1
    other_free = np.concatenate([free[len(chains) :], free[: len(chains)]])
    free &= other_free | (shapely.length(chains)[chain] > join_mm)
    return _Ends(points[free], chain[free], last[free])


def _pairs(chains: Array, ends: _Ends, join_mm: float) -> tuple[BoolArray, list[shapely.Geometry]]:
    """Pairs free ends that are at most `join_mm` apart, the nearest first.

    The two ends of one chain of up to 4 `join_mm` are not paired with each other: so short a chain is not a
    closed curve, but a link between two other chains.

    Returns:
        Whether each end (n,) is paired, and the line between the two ends of each pair.
    """
    pairs = cKDTree(ends.points).query_pairs(join_mm, output_type="ndarray")
    gaps = np.hypot(*(ends.points[pairs[:, 0]] - ends.points[pairs[:, 1]]).T)
    lengths = shapely.length(chains)
    paired = np.zeros(len(ends.points), np.bool_)
    bridges = []
    for one, other in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], gaps))]:
        short = ends.chain[one] == ends.chain[other] and lengths[ends.chain[one]] <= 4.0 * join_mm
        if not (paired[one] or paired[other] or short):
            paired[[one, other]] = True
            bridges.append(shapely.LineString(ends.points[[one, other]]))
    return paired, bridges


def _to_nearest(
    tree: shapely.STRtree, ends: _Ends, k: int, join_mm: float
) -> shapely.Geometry | None:
    """The shortest line from end `k` to another chain, or to a distant part of its own chain.

    None if this line would be longer than `join_mm`, or if the end already lies on a chain.
    """
    end, index = shapely.Point(ends.points[k]), int(ends.chain[k])
    near = tree.query(end, predicate="dwithin", distance=join_mm)
    lines = [tree.geometries[j] for j in near if j != index]
    chain = tree.geometries[index]
    if chain.length > 4.0 * join_mm:
        away = 4.0 * join_mm
        span = (0.0, -away) if ends.last[k] else (away, chain.length)
        lines.append(substring(chain, *span))
    distances = [line.distance(end) for line in lines]
    if not distances or not 0.0 < min(distances) <= join_mm:
        return None
    return shapely.shortest_line(end, lines[int(np.argmin(distances))])


def _joined(polygons: Array, thin: BoolArray) -> list[Region]:
    """Unites faces to regions; two faces are united if their outer boundaries share an edge.

    A shared edge becomes a seam of the region, unless one of the two faces is `thin`.
    """
    segments, faces = _shared_edges(polygons)
    links = coo_array((np.ones(len(faces)), faces.T), shape=(len(polygons), len(polygons)))
    count, group = connected_components(links, directed=False)
    seam = ~thin[faces].any(axis=1) if len(faces) else np.empty(0, np.bool_)
    result = []
    order = np.argsort(group, kind="stable")
    for members in np.split(order, np.searchsorted(group[order], np.arange(1, count))):
        filled = shapely.polygons(shapely.get_exterior_ring(polygons[members]))
        whole = shapely.get_parts(shapely.union_all(filled)) if len(members) > 1 else filled
        seams = []
        if len(members) > 1:
            inside = segments[seam & (group[faces[:, 0]] == group[members[0]])]
            seams = chains(inside)
        result += [Region(shapely.get_coordinates(part.exterior)[:-1], seams) for part in whole]
    return result


def _shared_edges(polygons: Array) -> tuple[Array, IntArray]:
    """Segments (n, 2, 2) that two outer boundaries share, and the indices (n, 2) of the two polygons."""
    points, owner = shapely.get_coordinates(shapely.get_exterior_ring(polygons), return_index=True)
    same = owner[1:] == owner[:-1]
    first, second, owner = points[:-1][same], points[1:][same], owner[:-1][same]
    dx, dy = (first - second).T
    back = (dx > 0.0) | ((dx == 0.0) & (dy > 0.0))
    segments = np.where(back[:, None], np.hstack([second, first]), np.hstack([first, second]))
    order = np.lexsort(segments.T)
    twice = np.flatnonzero((segments[order[1:]] == segments[order[:-1]]).all(axis=1))
    pairs = np.column_stack([owner[order[twice]], owner[order[twice + 1]]])
    return segments[order[twice]].reshape(-1, 2, 2), pairs


def overrun(region: Region, loose: Sequence[Array], lines: shapely.STRtree) -> int | None:
    """Finds a line that bounds a region and continues beyond it, like the extension line of a dimension.

    The piece beyond the region is one of the `loose` lines.

    Returns:
        The index of the line in the tree `lines`, or None if there is no such line.
    """
    if not loose:
        return None
    edges = shapely.linestrings(np.stack([region.ring, np.roll(region.ring, -1, axis=0)], axis=1))
    beyond = [shapely.LineString(line) for line in loose]
    return min(along(edges, lines) & along(beyond, lines), default=None)


def along(each: Sequence[shapely.Geometry] | Array, lines: shapely.STRtree) -> set[int]:
    """Returns the indices of all `lines` on which the midpoint of at least one line of `each` lies."""
    middles = shapely.line_interpolate_point(each, 0.5, normalized=True)
    return set(lines.query(middles, "dwithin", distance=BESIDE_MM)[1].tolist())
