"""Reads outline files of any format, by suffix; chooses, simplifies, checks and centres one contour."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from planner.arrays import Array
from planner.part import outline, symmetry
from planner.part.importers import contours, dxf, kicad, mesh, svg, table
from planner.part.importers.contours import Contour
from planner.part.importers.pieces import MAX_BYTES, Options, Pieces, place, time_limit, too_much
from runtime.shell.errors import InputError, UsageError

READERS = {".dxf": dxf, ".svg": svg, ".csv": table, ".kicad_mod": kicad, ".stl": mesh}
SUFFIXES = tuple(READERS)
SMALLEST_MM, LARGEST_MM = 0.5, 2000.0
"""Generous bounds on the larger extent of a part for fingers; outside, the unit is probably wrong."""
LEAST_SHARE = 0.01  # least share of the parts that lie on a face


DATUM = "the drawing's origin"
DATUM_MM = 10_000.0  # Largest distance of a job's datum from its part


class Imported(NamedTuple):
    """A checked and centred outline from a file, with its symmetry, its holes and the drawing's origin."""

    outline_mm: Array  # (N, 2) counter-clockwise, centroid at the origin, read-only
    symmetry: int  # rotational order of the outline
    size_mm: Array  # (2,) extent of the contour in x and y, as drawn
    notes: tuple[str, ...]  # notes on the drawing, one sentence each
    height_mm: float | None = None  # height of the solid; None for an outline
    holes_mm: tuple[Array, ...] = ()  # contours inside the outline, each (n, 2), in its frame
    origin_mm: tuple[float, float] = (0.0, 0.0)  # the drawing's datum in the outline's frame
    origin_name: str = DATUM  # which point of the drawing the datum is, for people


class Face(NamedTuple):
    """A face on which a solid may lie on the table, or several faces with the same outline."""

    share: float  # share of the parts that come to rest on it
    imported: Imported
    cut_mm: float  # height of the finger tips, equal for all faces of the solid
    down: tuple[tuple[float, float, float], ...]  # outward normals of the faces that may be down

    @property
    def down_text(self) -> str:
        """The outward normals of the faces that may be down, as text for people."""
        return " or ".join(f"({x:g}, {y:g}, {z:g})" for x, y, z in self.down)


def read_outline(path: Path, options: Options) -> Imported:
    """Reads an outline from a file that ends in one of `SUFFIXES`.

    Raises:
        UsageError: neither the file nor the options state the unit; the drawing has several outer contours,
            and the options choose none; the height is outside the solid; the suffix is unknown; or trimesh is
            not installed.
        InputError: the file is missing, too large, or of another format than its suffix; it holds no closed
            contour, or too many shapes; the contour crosses itself; or a line of a CSV file is not two
            numbers.
    """
    with _pieces(path, options) as pieces:
        candidates, notes = contours.contours(pieces, options.tolerance_mm)
        contour, more = contours.choose(candidates, options.contour, pieces.lost)
        holes = contours.holes_of(contour, candidates)
        imported = _checked(contour.points, holes, options.tolerance_mm, [*notes, *more])
        return imported._replace(height_mm=pieces.height_mm)


def read_contours(path: Path, options: Options) -> list[Contour]:
    """Returns all contours of a drawing, in the order in which `Options.contour` numbers them from 1.

    Raises:
        UsageError, InputError: see `read_outline`.
    """
    with _pieces(path, options) as pieces:
        return contours.contours(pieces, options.tolerance_mm)[0]


@contextmanager
def _pieces(path: Path, options: Options) -> Iterator[Pieces]:
    """Context manager that reads a file and yields its shapes; `_reading` limits the time of the body."""
    with _reading(path) as notes:
        suffix = _suffix_of(path, options)
        data = _bytes(path)
        pieces = READERS[suffix].read(data, options)
        notes += [*pieces.notes, *(shape.what for shape in pieces.lost if shape.box is None)]
        yield pieces


def _suffix_of(path: Path, options: Options) -> str:
    """Checks the options for reading a file; returns the file's suffix."""
    if not 1e-4 <= options.tolerance_mm <= 1.0:
        raise UsageError(f"--tolerance {options.tolerance_mm:g} is not between 0.0001 and 1 mm")
    if options.scale is not None and (options.units or not 1e-6 <= options.scale <= 1e6):
        raise UsageError("--scale states the mm of one unit, from 1e-6 to 1e6, instead of --units")
    suffix = path.suffix.lower()
    if options.layer is not None and suffix != ".dxf":
        raise UsageError("--layer is for DXF drawings; leave it out")
    return suffix


@contextmanager
def _reading(path: Path) -> Iterator[list[str]]:
    """Context manager that limits the time of reading a file, and yields a list for notes on the file.

    An `InputError` or `UsageError` in the body of the `with` statement is raised again with the file's name
    and with the notes.
    """
    notes: list[str] = []
    try:
        with time_limit():
            yield notes
    except (InputError, UsageError) as error:
        named = type(error)(f"{path}: {error}")
        for note in notes:
            if note not in str(named):
                named.add_note(note)
        raise named from error.__cause__


def read_faces(path: Path, options: Options, tips_mm: Callable[[float], float]) -> list[Face]:
    """Reads the outlines of a solid as it lies on each of its stable faces, the commonest face first.

    The finger tips have the same height above the table for all faces. If the options state no height, it is
    `tips_mm(h)`; h is the least height of the solid on any of the faces. Faces on which the solid has nearly
    the same height and outline are merged.

    Raises:
        UsageError: the file is no solid.
        ExpectedError: see `read_outline`; or the solid is not closed, or too thin on a face.
    """
    with _reading(path):
        if _suffix_of(path, options) != ".stl":
            raise UsageError("--faces are those of a solid; name an STL file")
        every = mesh.lying(_bytes(path), options)
        results = [face for face in every if face.share >= LEAST_SHARE]
        least_mm = min(float(np.ptp(face.solid.bounds[:, 2])) for face in results)
        height_mm = tips_mm(least_mm) if options.height_mm is None else options.height_mm
        if options.height_mm is not None and not 0.0 < height_mm < least_mm:
            raise UsageError(f"--height {height_mm:g} is not between 0 and {least_mm:.4g} mm")
        if height_mm <= 0.0:
            raise InputError(f"lies {least_mm:.3g} mm high, too thin for finger tips")
        faces: list[Face] = []
        for face in results:
            imported = _lying(face, height_mm, options.tolerance_mm)
            same = [k for k, other in enumerate(faces) if _alike(imported, other.imported)]
            if same:
                other = faces[same[0]]
                down = (*other.down, face.down)
                faces[same[0]] = other._replace(share=other.share + face.share, down=down)
            else:
                faces.append(Face(face.share, imported, height_mm, (face.down,)))
    total = sum(face.share for face in faces)
    shared = [face._replace(share=face.share / total) for face in faces]
    return sorted(shared, key=lambda face: -face.share)


def _lying(face: mesh.Lying, height_mm: float, tolerance_mm: float) -> Imported:
    """The outline of a solid that lies on a face: its outer contour, or the convex hull of several."""
    pieces = mesh.silhouette(face.solid, height_mm)
    result, notes = contours.contours(pieces, tolerance_mm)
    outer = [contour.points for contour in result if contour.outer]
    points = outer[0]
    if len(outer) > 1:
        hull = shapely.convex_hull(shapely.multipoints(np.concatenate(outer)))
        points = np.asarray(shapely.get_coordinates(hull)[:-1])
        notes.append(f"{len(outer)} contours, taken as their convex hull")
    imported = _checked(points, [], tolerance_mm, notes)
    return imported._replace(height_mm=pieces.height_mm)


def _alike(one: Imported, other: Imported) -> bool:
    """Whether a solid has nearly the same height and outline on two of its faces."""
    assert one.height_mm is not None
    assert other.height_mm is not None
    return abs(one.height_mm - other.height_mm) < mesh.WIDER_MM and symmetry.congruent(
        one.outline_mm, other.outline_mm, mesh.WIDER_MM
    )


def _bytes(path: Path) -> bytes:
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"not one of {', '.join(SUFFIXES)}; export the outline as one of these")
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}; check the path") from error
    if len(data) > MAX_BYTES:
        raise too_much(f"is larger than {MAX_BYTES >> 20} MB")
    return data


def _checked(points: Array, holes: list[Array], tolerance_mm: float, notes: list[str]) -> Imported:
    """Checks, simplifies and centres a contour.

    Converts the holes (n, 2) [mm] and the drawing's origin to the frame of the centred outline.
    """
    size = np.ptp(points, axis=0)
    if not SMALLEST_MM <= size.max() <= LARGEST_MM:
        problem = f"is {size[0]:.4g} x {size[1]:.4g} mm, which no gripper takes; is the unit right?"
        raise InputError(f"{problem} state --units, or --scale for a drawing in pixels")
    drawn, first = outline.canonical(_apart(points))
    simple, second = outline.canonical(outline.simplified(drawn, 0.5 * tolerance_mm))
    if len(simple) > outline.MOST_VERTICES:
        problem = f"still has {len(simple)} vertices at {tolerance_mm:g} mm; raise --tolerance"
        raise InputError(problem)
    order = symmetry.order(simple, max(tolerance_mm, symmetry.TOLERANCE_MM))
    shift = first + second
    origin, name = shift, DATUM
    if np.abs(shift).max() > DATUM_MM:
        origin = simple.min(axis=0)  # a point nearer the part than the drawing's origin
        name = f"the lower left corner of the part's box, {place(origin - shift)} mm in the drawing"
        metres = float(np.hypot(*shift)) / 1000
        far = f"the drawing's origin, {metres:.4g} m away, is too far for a datum; that is {name}"
        notes = [*notes, far]
    outlined = Imported(simple, order, size, tuple(notes))
    return outlined._replace(
        holes_mm=tuple(hole + shift for hole in holes),
        origin_mm=tuple(origin.tolist()),
        origin_name=name,
    )


def _apart(points: Array) -> Array:
    """Removes points that repeat the point before them.

    Raises:
        InputError: the contour touches itself.
    """
    gaps = np.hypot(*(points - np.roll(points, 1, axis=0)).T)
    fresh = points[gaps > 10 * outline.REPEAT_MM]
    places, times = np.unique(np.rint(fresh / (10 * outline.REPEAT_MM)), axis=0, return_counts=True)
    if times.max(initial=0) > 1:
        x, y = places[np.argmax(times)] * 10 * outline.REPEAT_MM
        touch = f"({x:.4g}, {y:.4g}) mm"
        raise InputError(f"the contour touches itself at {touch}; part it there in the drawing")
    return np.asarray(fresh)
