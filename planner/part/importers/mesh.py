"""STL solids, by trimesh: the cross-section where the fingers close, and the faces that they rest on."""

import io
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from planner.errors import InputFileError, OutlineError, UsageError
from planner.part.importers.pieces import MAX_SHAPES, Pieces, need_units, sorted_out, too_much

FARTHEST_MM = 1e6


class Lying(NamedTuple):
    """A solid at rest on one of its stable faces."""

    share: float  # of parts dropped in any orientation that come to rest on it
    down: tuple[float, float, float]  # that face's outward normal, as the solid was drawn
    solid: Any  # the trimesh, turned so that the face is down


def read(data: bytes, where: str, unit_mm: float | None, height_mm: float | None) -> Pieces:
    """The cuts of a solid with a plane `height_mm` above its lowest point, or half-way up; as `dxf.read`."""
    return cut(_solid(_trimesh(where), data, where, unit_mm), where, height_mm)


def lying(data: bytes, where: str, unit_mm: float | None) -> list[Lying]:
    """A solid on each facet of its convex hull that it can rest on, the commonest first, else by direction.

    The share of a facet is that of the directions in which a ray from the centre of mass passes through it,
    with those of the facets that tip over onto it. That is quasi-static: bouncing and rolling on are ignored.
    """
    trimesh = _trimesh(where)
    solid = _solid(trimesh, data, where, unit_mm)
    solid.merge_vertices()
    if not (solid.is_watertight and solid.is_winding_consistent):
        problem = "is no closed solid, so that its centre of mass is not known; repair it and export it again"
        raise InputFileError(problem, where=where)
    turns, shares = trimesh.poses.compute_stable_poses(solid)
    found = []
    for turn, share in zip(turns, shares, strict=True):
        down = tuple((np.round(-turn[2, :3], 3) + 0.0).tolist())
        found.append(Lying(float(share), down, solid.copy().apply_transform(turn)))
    return sorted(found, key=lambda face: (-round(face.share, 6), -face.down[2], face.down))


def cut(solid: Any, where: str, height_mm: float | None) -> Pieces:
    """The cuts of a solid with a plane `height_mm` above its lowest point, or half-way up.

    Raises:
        UsageError: the plane misses it.
        OutlineError: nothing is cut, or too much.
    """
    low, high = solid.bounds[:, 2].tolist()
    height = 0.5 * (high - low) if height_mm is None else height_mm
    if not 0.0 < height < high - low:
        raise UsageError(
            f"{where}: --height {height:g} is not between 0 and {high - low:.4g} mm; choose another"
        )
    cuts = _trimesh(where).intersections.mesh_plane(solid, (0.0, 0.0, 1.0), (0.0, 0.0, low + height))
    if len(cuts) > MAX_SHAPES:
        raise too_much(where, f"is cut in more than {MAX_SHAPES} places")
    if len(cuts) == 0:
        raise OutlineError("has no outline at that height; choose another --height", where=where)
    note = f"cut {height:.4g} mm above its lowest point, of {high - low:.4g} mm"
    found = sorted_out((np.asarray(cut)[:, :2] for cut in cuts), 0.0, where, [note])
    return found._replace(height_mm=high - low)


def _solid(trimesh: ModuleType, data: bytes, where: str, unit_mm: float | None) -> Any:
    if unit_mm is None:
        raise need_units(where, "is an STL file, which never says its units")
    try:
        solid = trimesh.load_mesh(io.BytesIO(data), file_type="stl", process=False)
        vertices = np.asarray(solid.vertices, dtype=np.float64) * unit_mm
        faces = np.asarray(solid.faces)
    except Exception as error:  # damage shows in many places of the parser
        raise InputFileError("is no STL file that can be read; export it again", where=where) from error
    if len(faces) == 0 or not np.isfinite(vertices).all():
        raise InputFileError("holds no triangles; export it again", where=where)
    if np.abs(vertices).max() > FARTHEST_MM:
        raise InputFileError(f"has a corner beyond {FARTHEST_MM:g} mm; export it again", where=where)
    return trimesh.Trimesh(vertices, faces, process=False)


def _trimesh(where: str) -> ModuleType:
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise UsageError(
            f"{where}: STL files need trimesh; install squeezetree[mesh]; in a clone: pip install '.[mesh]'"
        ) from error
    return trimesh
