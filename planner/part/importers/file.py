"""Any outline file, by its suffix: read, one contour chosen, simplified, checked and centred."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.errors import InputFileError, OutlineError, UsageError
from planner.part import outline, symmetry
from planner.part.importers import contours, dxf, mesh, svg, table
from planner.part.importers.pieces import MAX_BYTES, TOLERANCE_MM, UNITS_MM, time_limit

READERS = {".dxf": dxf.read, ".svg": svg.read, ".csv": table.read}
SUFFIXES = (*READERS, ".stl")
SMALLEST_MM, LARGEST_MM = 0.5, 2000.0
"""Extents of what fingers could close on, generously; beyond, the unit is wrong."""
MOST_VERTICES = 2000


class Options(NamedTuple):
    """How to read a file."""

    units: str | None = None  # one of `UNITS_MM`, or None to believe the file
    contour: int | None = None  # number of the contour, from 1, or None where there is only one
    tolerance_mm: float = TOLERANCE_MM  # largest distance of the outline from the curves drawn
    height_mm: float | None = None  # of the cut through a solid, or None for half-way up


class Imported(NamedTuple):
    """An outline from a file."""

    outline_mm: Array  # (N, 2) counter-clockwise, centroid at the origin, read-only
    symmetry: int  # its rotational order
    size_mm: Array  # (2,) extent of its bounding box, as drawn
    notes: tuple[str, ...]  # what a reader should know, one sentence each
    height_mm: float | None = None  # of the solid; None where the file holds an outline alone


def read_outline(path: Path, options: Options) -> Imported:
    """Reads an outline from a file that ends in one of `SUFFIXES`.

    Raises:
        UsageError: neither file nor options tell the unit or which contour is meant; the height lies beside
            the solid; the suffix is not known, or trimesh not installed.
        InputFileError: it is missing, too large, or not what its suffix says.
        OutlineError: it holds no closed contour, one that crosses itself, or too much.
        ValueRangeError: a line of a CSV file is not two numbers.
    """
    where = str(path)
    if not 1e-4 <= options.tolerance_mm <= 1.0:
        raise UsageError(f"--tolerance {options.tolerance_mm:g} is not between 0.0001 and 1 mm")
    data, suffix = _bytes(path), path.suffix.lower()
    unit_mm = UNITS_MM[options.units] if options.units else None
    with time_limit(where):
        if suffix == ".stl":
            pieces = mesh.read(data, where, unit_mm, options.height_mm)
        else:  # half the tolerance is for leaving vertices out
            pieces = READERS[suffix](data, where, unit_mm, 0.5 * options.tolerance_mm)
        found, notes = contours.contours(pieces, options.tolerance_mm, where)
        contour, more = contours.choose(found, options.contour, where)
        imported = _checked(contour.points, where, options.tolerance_mm, (*notes, *more))
        return imported._replace(height_mm=pieces.height_mm)


def _bytes(path: Path) -> bytes:
    where = str(path)
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"{where}: not one of {', '.join(SUFFIXES)}; export the outline as one of these")
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputFileError(f"cannot be read: {error.strerror}; check the path", where=where) from error
    if len(data) > MAX_BYTES:
        raise InputFileError(
            f"is larger than {MAX_BYTES >> 20} MB; export the part's outline alone", where=where
        )
    return data


def _checked(points: Array, where: str, tolerance_mm: float, notes: tuple[str, ...]) -> Imported:
    size = np.ptp(points, axis=0)
    if not SMALLEST_MM <= size.max() <= LARGEST_MM:
        problem = (
            f"is {size[0]:.4g} x {size[1]:.4g} mm, which no gripper takes; is the unit right? state --units"
        )
        raise OutlineError(problem, where=where)
    try:
        drawn = outline.canonical(_apart(points, where)).outline_mm
        simple = outline.canonical(outline.simplified(drawn, 0.5 * tolerance_mm)).outline_mm
    except OutlineError as error:
        raise OutlineError(error.problem, where=where) from None
    if len(simple) > MOST_VERTICES:
        problem = f"still has {len(simple)} vertices at {tolerance_mm:g} mm; raise --tolerance"
        raise OutlineError(problem, where=where)
    return Imported(simple, symmetry.order(simple, max(tolerance_mm, symmetry.TOLERANCE_MM)), size, notes)


def _apart(points: Array, where: str) -> Array:
    """The points without those that repeat the one before; refuses a contour that touches itself."""
    gaps = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
    fresh = points[gaps > 10 * outline.REPEAT_MM]
    places, times = np.unique(np.rint(fresh / (10 * outline.REPEAT_MM)), axis=0, return_counts=True)
    if times.max(initial=0) > 1:
        x, y = places[np.argmax(times)] * 10 * outline.REPEAT_MM
        problem = f"the contour touches itself at ({x:.4g}, {y:.4g}) mm; part it there in the drawing"
        raise OutlineError(problem, where=where)
    return np.asarray(fresh)
