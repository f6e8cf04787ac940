"""DXF drawings, by ezdxf: lines, arcs, polylines, splines, ellipses, in blocks or not, of the model space."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from ezdxf import disassemble, path, recover, units
from ezdxf.entities.spline import Spline
from ezdxf.layouts.blocklayout import BlockLayout
from ezdxf.layouts.layout import Modelspace
from ezdxf.lldxf.const import DXFError
from scipy.interpolate import BSpline

from planner.arrays import Array
from planner.errors import InputFileError, OutlineError, UsageError
from planner.part.importers import pieces

if TYPE_CHECKING:
    from ezdxf.document import Drawing
    from ezdxf.entities.dxfentity import DXFEntity

SHAPES = frozenset({"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"})
UNITS_MM = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1000.0, 8: 25.4e-6, 9: 0.0254, 13: 1e-3, 14: 100.0}
"""$INSUNITS (Autodesk's DXF reference, HEADER) in mm; what is left out measures no part."""
MAX_DEPTH = 50
ABSURD: Array = np.full((1, 2), np.inf)
"""Stands for a shape that is not pieces.flattened, since its coordinates are absurd; refused later."""


def read(
    data: bytes, where: str, unit_mm: float | None, tolerance_mm: float, layer: str | None = None
) -> pieces.Pieces:
    """The shapes of a DXF file; raises what `file.read_outline` does.

    `unit_mm` is what one unit of the drawing is (None: believe the file), `tolerance_mm` the largest distance
    of a chord from its curve, `layer` the only one that counts (None: all visible ones); `where` names the
    file in errors.
    """
    document = _document(data, where)
    scale, notes = _scale(document, where, unit_mm)
    space = document.modelspace()
    if layer is not None:
        drawn = {str(entity.dxf.get("layer", "0")) for each in (space, *document.blocks) for entity in each}
        names = {name.lower(): name for name in sorted(drawn)}
        if layer.lower() not in names:
            raise UsageError(
                f"{where}: has no layer {layer!r}; choose --layer of: {', '.join(names.values())}"
            )
    if _size(document, space, where) > pieces.MAX_SHAPES:
        raise pieces.too_much(where, f"draws more than {pieces.MAX_SHAPES} shapes, its blocks written out")
    curves, strays = [], Counter[str]()
    for entity in _visible(document, space, layer):
        if entity.dxftype() in SHAPES:
            curves.append(_points(entity, scale, tolerance_mm, where))
        else:
            strays[entity.dxftype()] += 1
    if strays:
        told = ", ".join(f"{n} {name}" for name, n in sorted(strays.items()))
        notes.append(f"not outlines, ignored: {told}")
    return pieces.sorted_out((curve for curve in curves if len(curve)), tolerance_mm, where, notes)


def _document(data: bytes, where: str) -> Drawing:
    if not data.strip():
        raise InputFileError("is empty; export the drawing again", where=where)
    if b"SECTION" not in data:  # of such a file the parser would make a drawing without shapes
        raise InputFileError("is no DXF file; export the drawing again, as DXF R2000 or later", where=where)
    try:
        document, _ = recover.read(io.BytesIO(data))
    except InputFileError:
        raise
    except Exception as error:  # the parser meets damage of all kinds in all its corners
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        problem = f"is no DXF file that can be read ({reason}); export it again, as DXF R2000 or later"
        raise InputFileError(problem, where=where) from error
    return document


def _scale(document: Drawing, where: str, unit_mm: float | None) -> tuple[float, list[str]]:
    stated = int(document.header.get("$INSUNITS", 0))
    known = UNITS_MM.get(stated)
    name = str(units.unit_name(stated)).lower() if known else ""
    if unit_mm is None:
        if known is None:
            raise pieces.need_units(where, "does not say its units ($INSUNITS)")
        return known, [f"units: {name}, as the file says"]
    if known is not None and known != unit_mm:
        return unit_mm, [f"the file says {name}, overruled by --units"]
    return unit_mm, []


def _size(document: Drawing, space: Modelspace, where: str) -> int:
    """How many shapes a drawing has when its blocks are written out, each as often as it is inserted."""
    known: dict[str, int] = {}

    def count(layout: BlockLayout | Modelspace, above: tuple[str, ...]) -> int:
        total = 0
        for entity in layout:
            if entity.dxftype() != "INSERT":
                total += 1
                continue
            name = str(entity.dxf.name).lower()
            if name in above or len(above) > MAX_DEPTH:
                raise OutlineError(
                    f"block {entity.dxf.name!r} contains itself; repair the drawing", where=where
                )
            block = document.blocks.get(name)
            if block is None:
                continue
            if name not in known:
                known[name] = count(block, (*above, name))
            copies = max(1, entity.dxf.get("row_count", 1)) * max(1, entity.dxf.get("column_count", 1))
            total += copies * known[name]
        return total

    return count(space, ())


def _visible(document: Drawing, space: Modelspace, only: str | None) -> Iterator[DXFEntity]:
    """The entities of the model space on layers that are switched on, or on one that is asked for."""
    hidden = {layer.dxf.name.lower() for layer in document.layers if layer.is_off() or layer.is_frozen()}
    for entity in disassemble.recursive_decompose(space):
        name = str(entity.dxf.get("layer", "0")).lower()
        if (name not in hidden) if only is None else (name == only.lower()):
            yield entity


def _points(entity: DXFEntity, scale: float, tolerance_mm: float, where: str) -> Array:
    try:
        if isinstance(entity, Spline) and len(entity.control_points):
            points = _spline(entity, tolerance_mm / scale)
        else:
            curve = path.make_path(entity)
            control = np.array([tuple(point)[:2] for point in curve.control_vertices()], dtype=np.float64)
            if not _sane(control, scale):
                return ABSURD
            points = np.array([(point.x, point.y) for point in curve.flattening(tolerance_mm / scale)])
        return points.reshape(-1, 2) * scale if _sane(points, scale) else ABSURD
    except (DXFError, ValueError, TypeError, ArithmeticError, IndexError) as error:
        problem = (
            f"its {entity.dxftype()} #{entity.dxf.get('handle', '?')} cannot be drawn; repair the drawing"
        )
        raise OutlineError(problem, where=where) from error


def _spline(entity: Spline, tolerance: float) -> Array:
    """A B-spline as a polyline (n, 2), over its own domain: from knot p to the last but p, p its degree."""
    degree, knots = entity.dxf.degree, np.array(entity.knots)
    control = np.array([tuple(point)[:2] for point in entity.control_points], dtype=np.float64)
    weights = np.array(entity.weights if len(entity.weights) else np.ones(len(control)))
    if not _sane(control, 1.0) or not np.isfinite(knots).all() or not (weights > 0.0).all():
        raise ValueError("no spline")
    homogeneous = BSpline(knots, np.column_stack([control * weights[:, None], weights]), degree)
    spans = np.unique(knots[degree : len(control) + 1])

    def piece(low: float, high: float, parameters: Array) -> Array:
        values = homogeneous(low + (high - low) * parameters)
        return np.asarray(values[:, :2] / values[:, 2:])

    return np.concatenate(
        [pieces.flattened(partial(piece, low, high), tolerance) for low, high in pairwise(spans.tolist())]
    )


def _sane(points: Array, scale: float) -> bool:
    return (
        bool(np.isfinite(points).all())
        and float(np.abs(points).max(initial=0.0)) * scale <= pieces.LARGEST_MM
    )
