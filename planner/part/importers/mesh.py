"""STL solids, by trimesh: the cross-section at one height, where the fingers close on the part."""

from __future__ import annotations

import io

import numpy as np

from planner.errors import InputFileError, OutlineError, UsageError
from planner.part.importers.pieces import MAX_SHAPES, Pieces, need_units, sorted_out, too_much

FARTHEST_MM = 1e6


def read(data: bytes, where: str, unit_mm: float | None, height_mm: float | None) -> Pieces:
    """The cuts of a solid with a plane `height_mm` above its lowest point, or half-way up; as `dxf.read`."""
    if unit_mm is None:
        raise need_units(where, "is an STL file, which never says its units")
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise UsageError(
            f"{where}: STL files need trimesh; install it with: pip install 'squeezetree[mesh]'"
        ) from error
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
    low, high = float(vertices[:, 2].min()), float(vertices[:, 2].max())
    height = 0.5 * (high - low) if height_mm is None else height_mm
    if not 0.0 < height < high - low:
        raise UsageError(
            f"{where}: --height {height:g} is not between 0 and {high - low:.4g} mm; choose another"
        )
    moved = trimesh.Trimesh(vertices, faces, process=False)
    cuts = trimesh.intersections.mesh_plane(  # type: ignore[no-untyped-call]
        moved, (0.0, 0.0, 1.0), (0.0, 0.0, low + height)
    )
    if len(cuts) > MAX_SHAPES:
        raise too_much(where, f"is cut in more than {MAX_SHAPES} places")
    if len(cuts) == 0:
        raise OutlineError("has no outline at that height; choose another --height", where=where)
    rings, strokes = sorted_out([np.asarray(cut)[:, :2] for cut in cuts], 0.0, where)
    note = f"cut {height:.4g} mm above its lowest point, of {high - low:.4g} mm"
    return Pieces(rings, strokes, [note], high - low)
