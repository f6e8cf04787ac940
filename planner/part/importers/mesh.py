"""Reads STL solids by trimesh: the outline that closing fingers meet, and the faces on which solids rest."""

import io
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import shapely

from planner.part.importers.pieces import Options, Pieces, need_units, sorted_out
from planner.part.tips import tips_height_mm
from runtime.shell.errors import InputError, UsageError

FARTHEST_MM = 1e5  # largest coordinate; STL files, in single precision, resolve 0.01 mm there
WIDER_MM = 0.1  # difference between heights or faces that is worth a note
CRACK_MM = 1e-3  # Largest gap between triangles due to rounded vertices
GRID_MM = 1e-4  # grid on which polygons are united
FLAT_MM2 = 1e-9  # Projected area below which a triangle is vertical
UP = (0.0, 0.0, 1.0)


class Lying(NamedTuple):
    """A solid at rest on one of its stable faces."""

    share: float  # share of parts dropped in any orientation that come to rest on it
    down: tuple[float, float, float]  # outward normal of this face, in the frame of the drawing
    solid: Any  # the trimesh, turned so that the face is down


def read(data: bytes, options: Options) -> Pieces:
    """Reads an STL file; returns the outline that `silhouette` describes."""
    return silhouette(_solid(data, options), options.height_mm)


def lying(data: bytes, options: Options) -> list[Lying]:
    """Returns a solid at rest on each stable facet of its convex hull, the commonest facet first.

    The share of a facet is proportional to the solid angle that the facet subtends at the centre of mass,
    plus the solid angles of the facets from which the solid tips over onto this one. Bouncing and rolling are
    ignored. Facets of equal share are sorted by their direction.

    Raises:
        UsageError: trimesh is not installed, or the unit is not stated.
        InputError: the file cannot be read, or the solid is not closed.
    """
    solid = _solid(data, options)
    if not (solid.is_watertight and solid.is_winding_consistent):
        problem = "is no closed solid, so that its centre of mass is not known; repair it and export it again"
        raise InputError(problem)
    turns, shares = _trimesh().poses.compute_stable_poses(solid)
    results = []
    for turn, share in zip(turns, shares, strict=True):
        down = tuple((np.round(-turn[2, :3], 3) + 0.0).tolist())
        results.append(Lying(float(share), down, solid.copy().apply_transform(turn)))
    return sorted(results, key=lambda face: (-round(face.share, 6), -face.down[2], face.down))


def silhouette(solid: Any, height_mm: float | None) -> Pieces:
    """Returns the outline that closing fingers meet: the projection of a solid above the finger tips.

    The tips are `height_mm` above the solid's lowest point. If `height_mm` is None, they are at their
    default height, or at half the height of a solid that is too thin for the default.

    Raises:
        UsageError: the tips are not between the lowest and the highest point of the solid.
        InputError: the solid is flat, or has no projection above the tips.
    """
    low, high = solid.bounds[:, 2].tolist()
    if low == high:
        raise InputError("is flat; export a solid")
    height = height_mm
    if height is None:  # a solid too thin for tips has an outline, too
        height = max(tips_height_mm(high - low), 0.0) or 0.5 * (high - low)
    if not 0.0 < height < high - low:
        problem = (
            f"--height {height:g} is not between 0 and {high - low:.4g} mm, the solid's height"
        )
        remedy = "choose another, or leave it out: it follows from the thickness"
        raise UsageError(f"{problem}; {remedy}")
    above = _shadow(solid, low + height)
    if above.is_empty:
        raise InputError("has no outline above that height; choose another --height")
    tips = f"{height:.4g} of {high - low:.4g} mm above its lowest point"
    notes = [f"silhouette of what is above the tips, {tips}"]
    if not solid.is_watertight:
        remedy = "compare the outline with the part, or repair it and export again"
        notes.append(f"its surface is not closed; {remedy}")
    hull = shapely.convex_hull(shapely.multipoints(solid.vertices[:, :2]))
    corners = shapely.points(shapely.get_coordinates(hull))
    beyond_mm = float(shapely.distance(corners, shapely.convex_hull(above)).max())
    if beyond_mm > WIDER_MM:
        wider = f"below the tips it is up to {beyond_mm:.3g} mm wider"
        notes.append(f"{wider}, where no finger meets it")
    polygons = shapely.get_parts(above)
    rings = [ring for polygon in polygons for ring in (polygon.exterior, *polygon.interiors)]
    pieces = sorted_out((shapely.get_coordinates(ring) for ring in rings), 0.0, notes)
    return pieces._replace(height_mm=high - low)


def _shadow(solid: Any, height: float) -> shapely.Geometry:
    """The projection of a solid above a height.

    The triangles above the height are projected. For a closed solid these suffice, since each vertical line
    that enters the solid also leaves it through a triangle. For an open surface, the section at the height is
    added.

    Raises:
        InputError: the surface has a hole at this height.
    """
    cut = _trimesh().intersections
    above = cut.slice_mesh_plane(solid, UP, (0.0, 0.0, height))
    above.merge_vertices()
    shadow = _union(_patches(above))
    if solid.is_watertight:
        return shadow
    lines = np.reshape(cut.mesh_plane(solid, UP, (0.0, 0.0, height)), (-1, 2, 3))[:, :, :2]
    section = shapely.union_all(shapely.linestrings(lines), grid_size=CRACK_MM)
    faces, cuts, dangles, _ = shapely.polygonize_full(shapely.get_parts(section))
    shadow = _union([shadow, *faces.geoms])
    for line in (*cuts.geoms, *dangles.geoms):
        if not shapely.covers(shapely.buffer(shadow, 2.0 * CRACK_MM), line):
            x, y = shapely.get_coordinates(line)[0]
            problem = f"has a hole in its surface near ({x:.4g}, {y:.4g}, {height:.4g}) mm; repair the solid"
            raise InputError(problem)
    return shadow


def _patches(surface: Any) -> list[shapely.Geometry]:
    """Projects the patches of a surface; a patch is connected triangles that all face up or all face down.

    The triangles of most patches do not overlap. They are united fast, by removal of their common edges.
    """
    corners = np.asarray(surface.triangles)[:, :, :2]
    one, other = (corners[:, k] - corners[:, 0] for k in (1, 2))
    areas = 0.5 * (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    facing = np.where(np.abs(areas) > FLAT_MM2, np.sign(areas), 0.0)
    seen = np.flatnonzero(facing)
    joined = surface.face_adjacency
    joined = joined[facing[joined[:, 0]] * facing[joined[:, 1]] > 0.0]
    graph = _trimesh().graph
    labels = graph.connected_component_labels(joined, node_count=len(facing))[seen]
    order = np.argsort(labels, kind="stable")
    starts = np.flatnonzero(np.diff(labels[order])) + 1
    groups = np.split(shapely.polygons(corners[seen][order]), starts)
    return [
        shapely.coverage_union_all(group)
        if len(group) > 1 and shapely.coverage_is_valid(group)
        else shapely.union_all(group, grid_size=GRID_MM)
        for group in groups
    ]


def _union(polygons: list[shapely.Geometry]) -> shapely.Geometry:
    """The union of polygons, with the cracks between them closed.

    The union is computed on a grid; otherwise GEOS loses some polygons whose edges nearly coincide.
    """
    whole = shapely.union_all(polygons, grid_size=GRID_MM)
    wider = shapely.buffer(whole, CRACK_MM, join_style="mitre")
    return shapely.buffer(wider, -CRACK_MM, join_style="mitre")


def _solid(data: bytes, options: Options) -> Any:
    trimesh = _trimesh()
    if options.unit_mm is None:
        raise need_units("is an STL file, which never says its units")
    try:
        solid = trimesh.load_mesh(io.BytesIO(data), file_type="stl", process=False)
        vertices = np.asarray(solid.vertices, dtype=np.float64) * options.unit_mm
        faces = np.asarray(solid.faces)
    except InputError:  # the time limit
        raise
    except Exception as error:  # damage raises many kinds of errors in the parser
        raise InputError("is no STL file that can be read; export it again") from error
    if len(faces) == 0 or not np.isfinite(vertices).all():
        raise InputError("holds no triangles; export it again")
    if np.abs(vertices).max() > FARTHEST_MM:
        problem = f"has a corner beyond {FARTHEST_MM:g} mm, where STL files round it"
        raise InputError(f"{problem}; export it near its origin")
    whole = trimesh.Trimesh(vertices, faces, process=False)
    whole.merge_vertices()
    return whole


def _trimesh() -> ModuleType:
    try:
        import trimesh
    except ModuleNotFoundError as error:
        remedy = "install squeezetree[mesh]; in a clone: pip install '.[mesh]'"
        raise UsageError(f"STL files need trimesh; {remedy}") from error
    return trimesh
