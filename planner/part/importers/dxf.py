"""Reads DXF drawings by ezdxf: lines, arcs, polylines, splines, ellipses and blocks of the model space."""

from __future__ import annotations

import io
import math
from typing import TYPE_CHECKING

from ezdxf import recover, units
from ezdxf.layouts.blocklayout import BlockLayout
from ezdxf.layouts.layout import Modelspace

from planner.part.importers import dxf_audit, dxf_view, pieces
from runtime.shell.errors import InputError, UsageError

if TYPE_CHECKING:
    from ezdxf.audit import Auditor
    from ezdxf.document import Drawing

UNITS_MM = {1: 25.4, 2: 304.8, 4: 1.0, 5: 10.0, 6: 1e3, 8: 25.4e-6, 9: 0.0254, 13: 1e-3, 14: 1e2}
"""Size in mm of the units that $INSUNITS states (Autodesk's DXF reference, HEADER); others suit no part."""
MAX_DEPTH = 50  # most levels of nested blocks


def read(data: bytes, options: pieces.Options) -> pieces.Pieces:
    """Returns the shapes of a DXF file.

    Error messages of this function do not name the file; the caller adds its name.

    Raises:
        UsageError: see `file.read_outline`; or the drawing lacks the layer that the options name.
        InputError: see `file.read_outline`.
    """
    document, auditor = _document(data)
    scale, notes = _scale(document, options.unit_mm)
    layer = options.layer
    space = document.modelspace()
    if layer is not None:
        drawn = {dxf_view.layer_of(entity) for each in (space, *document.blocks) for entity in each}
        names = {name.lower(): name for name in sorted(drawn)}
        if layer.lower() not in names:
            known = ", ".join(names.values())
            raise UsageError(f"has no layer {layer!r}; choose --layer of: {known}")
    if _size(document, space) > pieces.MAX_SHAPES:
        raise pieces.too_much(f"draws more than {pieces.MAX_SHAPES} shapes, its blocks written out")
    losses = dxf_audit.losses(auditor, data)
    shown = dxf_view.view(document, scale, options.chord_mm, layer)
    notes += [*losses.repairs, *shown.notes]
    if not shown.curves:
        notes += _elsewhere(document)
    sorted_out = pieces.sorted_out(shown.curves, options.chord_mm, notes)
    return sorted_out._replace(lost=(*losses.lost, *shown.lost))


def _document(data: bytes) -> tuple[Drawing, Auditor]:
    if not data.strip():
        raise InputError("is empty; export the drawing again")
    if b"SECTION" not in data:  # the parser would read such a file as a drawing without shapes
        raise InputError("is no DXF file; export the drawing again, as DXF R2000 or later")
    if data.startswith(b"AutoCAD Binary DXF"):
        raise InputError("is a binary DXF file; export it again, as text (ASCII)")
    try:
        return recover.read(io.BytesIO(data))
    except InputError:
        raise
    except Exception as error:  # the parser raises all kinds of errors for damaged files
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        problem = f"is no DXF file that can be read ({reason})"
        raise InputError(f"{problem}; export it again, as DXF R2000 or later") from error


def _scale(document: Drawing, unit_mm: float | None) -> tuple[float, list[str]]:
    stated = int(document.header.get("$INSUNITS", 0))
    known = UNITS_MM.get(stated)
    name = str(units.unit_name(stated)).lower() if known else ""
    if unit_mm is None:
        if known is None:
            raise pieces.need_units("does not say its units ($INSUNITS)")
        return known, [f"units: {name}, as the file says"]
    if known is not None and known != unit_mm:
        return unit_mm, [f"the file says {name}, overruled by --units"]
    return unit_mm, []


def _size(document: Drawing, space: Modelspace) -> int:
    """Number of shapes of a drawing; the shapes of a block count as often as the block is inserted."""
    known: dict[str, int] = {}

    def count(layout: BlockLayout | Modelspace, above: tuple[str, ...]) -> int:
        total = 0
        for entity in layout:
            if entity.dxftype() != "INSERT":
                total += 1
                continue
            name = str(entity.dxf.name).lower()
            if name in above or len(above) > MAX_DEPTH:
                raise InputError(f"block {entity.dxf.name!r} contains itself; repair the drawing")
            block = document.blocks.get(name)
            if block is None:
                continue
            if name not in known:
                known[name] = count(block, (*above, name))
            counts = (entity.dxf.get(f"{line}_count", 1) for line in ("row", "column"))
            total += math.prod(max(1, number) for number in counts) * known[name]
        return total

    return count(space, ())


def _elsewhere(document: Drawing) -> list[str]:
    """Returns notes for a drawing whose model space is empty: one on each other layout that holds shapes."""
    counts = {
        layout.name: sum(entity.dxftype() != "VIEWPORT" for entity in layout)
        for layout in document.layouts
        if not layout.is_modelspace
    }
    return [
        f"the model space shows no shapes, the layout {name!r} holds {count}; export the model space"
        for name, count in counts.items()
        if count
    ]
