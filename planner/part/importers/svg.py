"""Reads SVG drawings as a viewer shows them: resolves transforms and copies (`use`).

The file is parsed by defusedxml, which refuses entities. The y axis of the picture points down, the y axis of
the part points up.
"""

from xml.etree import ElementTree as Tree

import numpy as np
import shapely
from defusedxml import DefusedXmlException
from defusedxml import ElementTree as SafeTree

from planner.arrays import Array
from planner.part.importers import pieces
from planner.part.importers.svg_scene import SIZES, Scene
from planner.part.importers.svg_shapes import polylines
from planner.part.importers.svg_style import INHERITED, Sheets
from planner.part.importers.svg_values import PHYSICAL_MM, PIXEL_MM, Values, Viewport, is_physical
from runtime.shell.errors import InputError

ASPECT = 1e-3  # tolerated relative difference of two scales


def read(data: bytes, options: pieces.Options) -> pieces.Pieces:
    """Returns the shapes of an SVG file; see `dxf.read`.

    If the options state no unit, the scale follows from the file's width, height and viewBox. A length with a
    unit, such as 40mm, does not depend on the scale.
    """
    root, unit_mm, tolerance_mm = _root(data), options.unit_mm, options.chord_mm
    sheets = Sheets(root)
    page = Values(sheets.style(root, INHERITED), Viewport(None, None), 1.0, "<svg>")
    box = _box(page)
    stated = _stated_scale(page, box)
    scale = unit_mm if unit_mm is not None else stated
    if scale is None:
        size = "its size in mm, cm, in or pt (width, height and viewBox)"
        raise pieces.need_units(f"does not say {size}")
    notes = []
    if unit_mm is None:
        notes.append(f"scale: {scale:.6g} mm a unit, as the file's width and viewBox say")
    elif stated is not None and abs(stated / unit_mm - 1.0) > ASPECT:
        notes.append(f"the file says {stated:.6g} mm a unit, overruled by --units")
    if stated is not None and abs(stated / PIXEL_MM - 1.0) > ASPECT and _states_lengths(root):
        drawn = f"viewers draw them {stated / PIXEL_MM:.4g} times so long"
        notes.append(f"lengths with a unit taken as they are; {drawn}")
    scene = Scene(root, sheets, _viewport(page._replace(unit_mm=scale), box), scale)
    curves = _curves(scene, scale, tolerance_mm)
    unread = ["xml-stylesheet"] * (b"<?xml-stylesheet" in data) + list(dict.fromkeys(sheets.unread))
    if unread:
        notes.append(f"style rules not read, compare what is seen: {', '.join(unread)}")
    if scene.unseen and not curves:
        why = "; ".join([*notes, *scene.notes()])
        raise InputError(f"shows no line: {why}; make the part's outline visible")
    return pieces.sorted_out(curves, tolerance_mm, [*notes, *scene.notes()])


def _root(data: bytes) -> Tree.Element:
    try:
        root = SafeTree.fromstring(
            data, forbid_dtd=False, forbid_entities=True, forbid_external=True
        )
    except DefusedXmlException as error:
        problem = "holds XML entities, which are not read; export it again as plain SVG"
        raise InputError(problem) from error
    except (Tree.ParseError, ValueError, LookupError, RecursionError) as error:
        raise InputError(f"is no SVG file ({error}); export it again") from error
    if not isinstance(root, Tree.Element) or str(root.tag).rpartition("}")[2] != "svg":
        raise InputError("is XML, but no SVG drawing; export it again")
    return root


def _box(page: Values) -> list[float] | None:
    """The view box of the whole drawing: x, y, width and height; None if there is no usable one."""
    try:
        box = page.box()
    except InputError:  # with --units, nothing depends on the view box
        return None
    return box if box and min(box[2:]) > 0.0 else None


def _stated_scale(page: Values, box: list[float] | None) -> float | None:
    """Size of one user unit [mm]: the drawing's physical size divided by its viewBox.

    None if either is missing.
    """
    scales = []
    for name, extent in zip(SIZES, box[2:] if box else (0.0, 0.0), strict=True):
        size = page.stated(name)
        if size and size.unit in PHYSICAL_MM and extent > 0.0:
            scales.append(size.value * PHYSICAL_MM[size.unit] / extent)
    if not scales or min(scales) <= 0.0:
        return None
    if max(scales) / min(scales) > 1.0 + ASPECT:
        problem = "width and height give two different scales; make them fit the viewBox, or state --units"
        raise InputError(problem)
    return scales[0]


def _viewport(page: Values, box: list[float] | None) -> Viewport:
    """The size of the drawing in user units."""
    if box:
        return Viewport(*box[2:])
    shares = {name for name in SIZES if "%" in page.style.get(name, "")}
    return Viewport(*(None if name in shares else page.length(name) for name in SIZES))


def _states_lengths(root: Tree.Element) -> bool:
    """Whether the size or position of some element below the root has a physical unit."""
    below = (each for each in root.iter() if each is not root)
    return any(is_physical(name, text) for each in below for name, text in each.items())


def _curves(scene: Scene, scale: float, tolerance_mm: float) -> list[Array]:
    """Returns all shapes as polylines (n, 2) [mm]."""
    curves: list[Array] = []
    try:
        for kind, values, matrix, window in scene.shapes():
            stretch = float(np.linalg.norm(matrix[:2, :2], 2))
            tolerance = tolerance_mm / scale
            drawn = polylines(kind, values, tolerance / stretch) if stretch > 0.0 else []
            placed = [curve @ matrix[:2, :2].T + matrix[:2, 2] for curve in drawn if len(curve) > 1]
            if window is not None and placed:
                every = shapely.multipoints(np.concatenate(placed))
                if shapely.disjoint(shapely.convex_hull(every), window):
                    scene.unseen += 1
                    continue
                scene.cut += not shapely.covers(shapely.buffer(window, tolerance), every)
            curves += [curve * (scale, -scale) for curve in placed]
    except (ValueError, TypeError, ArithmeticError, IndexError, AttributeError, KeyError) as error:
        problem = f"a shape cannot be drawn ({error}); export it again, as plain paths"
        raise InputError(problem) from error
    return curves
