"""SVG drawings, by svgelements: paths and basic shapes, transforms and copies (`use`) worked out.

The file is parsed by defusedxml, which refuses entities. The picture's y axis points down, the part's up.
"""

import io
import re
from functools import partial
from xml.etree import ElementTree as Tree

import numpy as np
import svgelements
from defusedxml import DefusedXmlException
from defusedxml import ElementTree as SafeTree

from planner.arrays import Array
from planner.errors import InputFileError, OutlineError
from planner.part.importers import pieces

LENGTH = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(mm|cm|in|pt|pc|Q|px|%)?\s*$")
PHYSICAL_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "Q": 0.25}
MAX_DEPTH = 100
XLINK = "{http://www.w3.org/1999/xlink}href"
ASPECT = 1e-3


def read(data: bytes, where: str, unit_mm: float | None, tolerance_mm: float) -> pieces.Pieces:
    """The shapes of an SVG file; as `dxf.read`, a unit_mm of None believes its width and viewBox."""
    root = _root(data, where)
    if _size(root, where) > pieces.MAX_SHAPES:
        raise pieces.too_much(where, f"draws more than {pieces.MAX_SHAPES} shapes, its copies written out")
    stated = _stated_scale(root, where)
    scale = unit_mm if unit_mm is not None else stated
    if scale is None:
        raise pieces.need_units(
            where, "does not say its size in mm, cm, in or pt (width, height and viewBox)"
        )
    notes = []
    if unit_mm is None:
        notes.append(f"scale: {scale:.6g} mm a unit, as the file's width and viewBox say")
    elif stated is not None and abs(stated / unit_mm - 1.0) > ASPECT:
        notes.append(f"the file says {stated:.6g} mm a unit, overruled by --units")
    for name in ("width", "height", "viewBox", "preserveAspectRatio"):
        root.attrib.pop(name, None)
    curves = _curves(Tree.tostring(root, "utf-8"), scale, tolerance_mm, where)
    return pieces.sorted_out(curves, tolerance_mm, where, notes)


def _root(data: bytes, where: str) -> Tree.Element:
    try:
        root = SafeTree.fromstring(data, forbid_dtd=False, forbid_entities=True, forbid_external=True)
    except DefusedXmlException as error:
        problem = "holds XML entities, which are not read; export it again as plain SVG"
        raise InputFileError(problem, where=where) from error
    except (Tree.ParseError, ValueError, LookupError, RecursionError) as error:
        raise InputFileError(f"is no SVG file ({error}); export it again", where=where) from error
    if not isinstance(root, Tree.Element) or _local(root) != "svg":
        raise InputFileError("is XML, but no SVG drawing; export it again", where=where)
    return root


def _local(element: Tree.Element) -> str:
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _size(root: Tree.Element, where: str) -> int:
    """How many elements there are when each `use` is written out."""
    named = {element.get("id"): element for element in root.iter() if element.get("id")}
    known: dict[int, int] = {}

    def count(element: Tree.Element, above: tuple[int, ...]) -> int:
        if id(element) in known:
            return known[id(element)]
        if len(above) > MAX_DEPTH or id(element) in above:
            raise OutlineError("is nested too deeply, or in itself; export it again", where=where)
        inside = (*above, id(element))
        total = 1 + sum(count(child, inside) for child in element)
        if _local(element) == "use":
            target = named.get((element.get("href") or element.get(XLINK) or "").removeprefix("#"))
            total += count(target, inside) if target is not None else 0
        known[id(element)] = total
        return total

    return count(root, ())


def _stated_scale(root: Tree.Element, where: str) -> float | None:
    """Millimetres a user unit by the root's physical size and viewBox, None where one is missing."""
    try:
        box = [float(part) for part in re.split(r"[\s,]+", root.get("viewBox", "").strip())]
    except ValueError:
        return None
    scales = []
    for name, extent in zip(("width", "height"), box[2:4], strict=False):
        found = LENGTH.match(root.get(name, ""))
        if found and found[2] in PHYSICAL_MM and extent > 0.0:
            scales.append(float(found[1]) * PHYSICAL_MM[found[2]] / extent)
    if not scales or min(scales) <= 0.0:
        return None
    if max(scales) / min(scales) > 1.0 + ASPECT:
        problem = "width and height give two different scales; make them fit the viewBox, or state --units"
        raise OutlineError(problem, where=where)
    return scales[0]


def _curves(svg: bytes, scale: float, tolerance_mm: float, where: str) -> list[Array]:
    """All shapes as polylines (n, 2) [mm]."""
    curves: list[Array] = []
    try:
        drawing = svgelements.SVG.parse(io.BytesIO(svg), reify=True, ppi=96.0)
        for element in drawing.elements():
            if isinstance(element, svgelements.Shape) and element.values.get("display") != "none":
                for part in svgelements.Path(element).as_subpaths():
                    curves.append(_polyline(part, tolerance_mm / scale) * (scale, -scale))
    except OutlineError as error:
        raise OutlineError(error.problem, where=where) from None
    except (ValueError, TypeError, ArithmeticError, IndexError, AttributeError, KeyError) as error:
        problem = f"a shape cannot be drawn ({error}); export it again, as plain paths"
        raise InputFileError(problem, where=where) from error
    return [curve for curve in curves if len(curve) > 1]


def _polyline(part: svgelements.Subpath, tolerance: float) -> Array:
    points: list[Array] = []
    for segment in part:
        if isinstance(segment, svgelements.Move) or segment.start is None or segment.end is None:
            continue
        if isinstance(segment, svgelements.Line | svgelements.Close):
            ends = [(segment.start.x, segment.start.y), (segment.end.x, segment.end.y)]
            points.append(np.array(ends, dtype=np.float64))
            continue
        coarse = _at(segment, np.linspace(0.0, 1.0, 9))
        if not np.isfinite(coarse).all() or np.abs(coarse).max() > pieces.LARGEST_MM / tolerance * 0.02:
            raise OutlineError("has a coordinate that is not finite or absurdly large; repair the drawing")
        points.append(pieces.flattened(partial(_at, segment), tolerance))
    if not points:
        return np.empty((0, 2))
    every = np.concatenate(points)
    fresh = np.ones(len(every), np.bool_)
    fresh[1:] = np.any(every[1:] != every[:-1], axis=1)
    return np.asarray(every[fresh])


def _at(segment: svgelements.PathSegment, parameters: Array) -> Array:
    return np.array([(point.x, point.y) for point in map(segment.point, parameters)], dtype=np.float64)
