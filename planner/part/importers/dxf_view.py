"""Finds the visible shapes of a DXF drawing's model space.

ezdxf's rendering front end decides what is visible; it knows layers, blocks and flags.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from ezdxf import bbox, path
from ezdxf.addons.drawing.config import Configuration, LinePolicy, ProxyGraphicPolicy
from ezdxf.addons.drawing.frontend import Frontend
from ezdxf.addons.drawing.properties import RenderContext
from ezdxf.addons.drawing.recorder import PathRecord, Recorder
from ezdxf.entities.dxfentity import DXFTagStorage
from ezdxf.entities.insert import Insert
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.entities.polyline import DXFVertex, Polyline
from ezdxf.entities.spline import Spline
from ezdxf.lldxf.const import DXFError
from ezdxf.math import Matrix44, Vec3
from scipy.interpolate import BSpline, CubicSpline

from planner.arrays import Array
from planner.part.importers import pieces
from runtime.shell.errors import InputError

if TYPE_CHECKING:
    from ezdxf.addons.drawing.properties import LayerProperties, Properties
    from ezdxf.document import Drawing
    from ezdxf.entities.dxfentity import DXFEntity
    from ezdxf.entities.dxfgfx import DXFGraphic

SHAPES = frozenset({"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE"})
ANNOTATION = re.compile(
    r"\w*DIMENSION|\w*TEXT|ATTDEF|ATTRIB|M?(ULTI)?LEADER|TOLERANCE|ACAD_TABLE|POINT|RAY|XLINE|IMAGE|WIPEOUT|"
    r"OLE2FRAME|VIEWPORT|LIGHT|CAMERA|SECTION|GEOPOSITIONMARKER|\w+UNDERLAY"
)
"""Kinds of entities that are never an outline."""
FILLED = frozenset({"HATCH", "MPOLYGON", "SOLID", "TRACE", "3DFACE", "MESH"})
"""Kinds of entities that are an outline only if they surround all others."""
INVISIBLE = "invisible"  # ezdxf's reason for not drawing a hidden entity
LAYER = 8  # DXF group code of a layer's name
STRAIGHT = 1e-9  # largest sine of an angle that counts as zero
FAR = 1e4
"""Distance [units] beyond which shapes are drawn about a local origin.

ezdxf treats points as equal if they differ by 1e-9 of their coordinates.
"""
ABSURD: Array = np.full((1, 2), np.inf)
"""Placeholder for a shape that is not flattened, since its coordinates are absurd; refused later."""


class View(NamedTuple):
    """The curves that are read from a drawing, the visible shapes that are not read, and notes."""

    curves: list[pieces.Curve]
    lost: list[pieces.Lost]  # shapes that are shown, but not read
    notes: list[str]


def view(document: Drawing, scale: float, tolerance_mm: float, only: str | None) -> View:
    """Reads the visible, plotted curves of the model space; also records the shapes that are not read.

    Args:
        document: the drawing.
        scale: size of a unit [mm].
        tolerance_mm: largest distance of a chord from its curve.
        only: the one layer to read, even if that layer is hidden or not plotted; None: all layers.

    Raises:
        InputError: a shape cannot be drawn.
    """
    document.header["$XCLIPFRAME"] = 0  # the frame of a clip is no shape
    _write_out_arrays(document)
    viewer = _Viewer(document, scale, tolerance_mm / scale, only)
    viewer.draw_layout(document.modelspace())
    curves = [
        pieces.Curve(_flattened(record, scale, tolerance_mm), properties.layer)
        for record, properties in viewer.recorder.player().recordings()
        if isinstance(record, PathRecord)
    ]
    return View([curve for curve in curves if len(curve.points)], viewer.lost, viewer.notes())


def _write_out_arrays(document: Drawing) -> None:
    """Replaces each array INSERT within a block by single INSERTs.

    ezdxf does not scale the spacing of an array with the block around it.
    """
    for block in document.blocks:
        arrays = [each for each in block if isinstance(each, Insert) and each.mcount > 1]
        for array in [] if block.is_any_layout else arrays:
            for insert in array.multi_insert():
                block.add_entity(insert)
            block.delete_entity(array)


def _flattened(record: PathRecord, scale: float, tolerance_mm: float) -> Array:
    control = np.array([(point.x, point.y) for point in record.path.vertices()])
    if not _sane(control, scale):
        return ABSURD
    points = record.path.flattening(tolerance_mm / scale)
    return np.array([(point.x, point.y) for point in points]).reshape(-1, 2) * scale


class _Viewer(Frontend):
    """Draws the visible shapes by ezdxf.

    Other entities are recorded as lost if they may be the outline, and else counted by kind. If only one
    layer is read, shapes on other layers are ignored.
    """

    def __init__(self, document: Drawing, scale: float, tolerance: float, only: str | None) -> None:
        context = RenderContext(document)
        context.set_layer_properties_override(self._show_asked)
        settings = Configuration(
            line_policy=LinePolicy.SOLID,
            proxy_graphic_policy=ProxyGraphicPolicy.IGNORE,
            max_flattening_distance=tolerance,
        )
        self._only = only.lower() if only is not None else None
        self.recorder = Recorder()
        super().__init__(context, self.recorder, settings)
        layers = {layer.dxf.name.lower(): layer for layer in document.layers}
        layers.pop(self._only, None)
        self._frozen = {name for name, layer in layers.items() if layer.is_frozen()}
        self._unplotted = {name for name, layer in layers.items() if not layer.dxf.plot}
        self._scale, self._tolerance = scale, tolerance
        self._hidden, self._strays = Counter[str](), Counter[str]()
        self._edge_on, self._not_plotted = Counter[str](), Counter[str]()
        self._widths: list[float] = []
        self.lost: list[pieces.Lost] = []

    def notes(self) -> list[str]:
        """Notes on the drawing, one sentence each."""
        counts = (
            ("not outlines, ignored", self._strays, ""),
            ("not visible, left out", self._hidden, ""),
            ("seen edge-on, left out", self._edge_on, "; draw the outline in x and y"),
            ("not plotted, left out", self._not_plotted, "; --layer reads a layer"),
        )
        notes = [f"{what}: {pieces.counted(kinds)}{hint}" for what, kinds, hint in counts if kinds]
        if self._widths:
            widest_mm = max(self._widths) * self._scale
            what = f"polylines with a width: {len(self._widths)}, up to {widest_mm:.4g} mm wide"
            notes.append(f"{what}; the outline runs along their middle")
        return notes

    def _show_asked(self, layers: Sequence[LayerProperties]) -> None:
        for layer in layers:
            layer.is_visible |= layer.layer.lower() == self._only

    def skip_entity(self, entity: DXFEntity, msg: str) -> None:
        """Records an entity that ezdxf does not draw, as hidden or as lost.

        ezdxf calls this method with the reason `msg`.
        """
        layer, block = layer_of(entity).lower(), self.ctx.current_block_reference_properties
        if layer == "0" and block is not None:
            layer = block.layer.lower()
        if msg == INVISIBLE or (layer in self.ctx.layers and not self.ctx.layers[layer].is_visible):
            self._hidden[entity.dxftype()] += 1
        elif self._only in (None, layer):
            self._lose(entity, msg)

    def draw_entity(self, entity: DXFGraphic, properties: Properties) -> None:
        """Draws an entity or records it as not drawn.

        ezdxf calls this method for visible entities, and for INSERTs on any layer.
        """
        kind, layer = entity.dxftype(), properties.layer.lower()
        if isinstance(entity, Insert):
            self._draw_block(entity, properties)
        elif self._only is not None and layer != self._only:
            return
        elif kind == "MLINE":
            super().draw_entity(entity, properties)
        elif layer in self._unplotted and kind in SHAPES:
            self._not_plotted[f"{kind} (layer {properties.layer})"] += 1
            self._lose_around(entity, f"on layer {properties.layer} is not plotted")
        elif kind in SHAPES:
            self._draw_shape(entity, properties)
        elif kind in FILLED:
            self._strays[kind] += 1
            self._lose_around(entity, "is not read")
        else:
            self._lose(entity, "such shapes are not read")

    def _draw_block(self, insert: Insert, properties: Properties) -> None:
        block = insert.block()
        if properties.layer.lower() in self._frozen:
            self.skip_entity(insert, INVISIBLE)
        elif block is None or block.block is None:
            self._lose(insert, f"block {insert.dxf.name!r} is not defined")
        elif block.block.is_xref or block.block.is_xref_overlay:
            if self._only in (None, properties.layer.lower()):
                self._lose(insert, f"block {insert.dxf.name!r} is another file (xref); bind it")
        elif _is_skewed(insert):
            self._lose(insert, f"block {insert.dxf.name!r} skews a block that it holds; explode it")
        else:
            super().draw_entity(insert, properties)

    def _lose(self, entity: DXFEntity, why: str) -> None:
        if ANNOTATION.fullmatch(entity.dxftype()):
            self._strays[entity.dxftype()] += 1
        else:
            self.lost.append(pieces.Lost(f"{_name(entity)}: {why}"))

    def _lose_around(self, entity: DXFGraphic, why: str) -> None:
        """Records a shape that is not drawn as lost, with its bounding box.

        If the box surrounds an outer contour, the shape may be the true outline. Then
        `contours.choose` refuses the drawing.
        """
        box = bbox.extents([entity])
        if box.has_data:
            corners = np.array([tuple(box.extmin)[:2], tuple(box.extmax)[:2]])
            what = f"{_name(entity)} {why}, and goes around it"
            self.lost.append(pieces.Lost(what, corners * self._scale))

    def _draw_shape(self, entity: DXFGraphic, properties: Properties) -> None:
        try:
            shape = _path(entity, self._tolerance)
            if _is_edge_on(shape):
                self._edge_on[entity.dxftype()] += 1
            elif len(shape):
                self.pipeline.draw_path(shape, properties)
        except (DXFError, ValueError, TypeError, ArithmeticError, IndexError) as error:
            raise InputError(f"its {_name(entity)} cannot be drawn; repair the drawing") from error
        if isinstance(entity, LWPolyline | Polyline) and entity.has_width:
            self._widths.append(_width(entity))


def layer_of(entity: DXFEntity) -> str:
    """The name of an entity's layer, also for kinds of entities that ezdxf does not know."""
    if isinstance(entity, DXFTagStorage):
        tags = (tag for part in entity.xtags.subclasses for tag in part)
        return next((str(tag.value) for tag in tags if tag.code == LAYER), "0")
    return str(entity.dxf.get("layer", "0"))


def _name(entity: DXFEntity) -> str:
    handle = entity.dxf.get("handle")
    return f"{entity.dxftype()} #{handle}" if handle else f"{entity.dxftype()} in a block"


def _width(entity: LWPolyline | Polyline) -> float:
    if isinstance(entity, LWPolyline):
        tapered = (max(ends) for ends in entity.get_points("se"))
        widths = [entity.dxf.get("const_width", 0.0), *tapered]
    else:
        ends = ("start_width", "end_width")
        widths = [entity.dxf.get(f"default_{end}", 0.0) for end in ends]
        widths += [vertex.dxf.get(end, 0.0) for vertex in entity.vertices for end in ends]
    return float(max(widths))


def _is_skewed(insert: Insert) -> bool:
    """Whether a block scales x and y differently and holds a rotated block; ezdxf draws this wrongly."""
    if math.isclose(abs(insert.dxf.xscale), abs(insert.dxf.yscale), rel_tol=1e-9):
        return False
    inner = (entity for entity in insert.block() or () if isinstance(entity, Insert))
    return any(abs(math.sin(math.radians(entity.dxf.rotation))) > STRAIGHT for entity in inner)


def _path(entity: DXFGraphic, tolerance: float) -> path.Path:
    """Returns the path of a shape.

    The path of a spline, or of a shape far from the origin, is computed about a point of the shape and moved
    back, since ezdxf takes neighbouring points far from the origin for equal.
    """
    if isinstance(entity, Spline) and (len(entity.control_points) or entity.closed):
        drawn = _spline if len(entity.control_points) else _closed_spline
        points = drawn(entity, tolerance)
        origin = np.round(points[0])
        return _moved(path.from_vertices((points - origin).tolist()), Vec3(*origin))
    if isinstance(entity, Polyline):  # frame points of a fitted curve are not part of it
        frame = DXFVertex.SPLINE_FRAME_CONTROL_POINT
        entity.vertices[:] = [v for v in entity.vertices if not v.dxf.flags & frame]
    shape = path.make_path(entity)
    if not len(shape) or shape.start.magnitude < FAR:
        return shape
    origin = shape.start.round(0)
    return _moved(path.make_path(entity.copy().translate(*-origin)), origin)


def _is_edge_on(shape: path.Path) -> bool:
    """Whether a closed curve stands upright, so that it has no area as seen from above."""
    corners = np.array([tuple(point) for point in shape.control_vertices()]).reshape(-1, 3)
    if not len(corners) or not shape.is_closed or np.ptp(corners[:, 2]) <= STRAIGHT:
        return False
    seen = np.linalg.svd(corners[:, :2] - corners[0, :2], compute_uv=False)
    return bool(seen[-1] <= STRAIGHT * seen[0])


def _moved(shape: path.Path, origin: Vec3) -> path.Path:
    return shape.transform(Matrix44.translate(*origin))


def _spline(entity: Spline, tolerance: float) -> Array:
    """Converts a B-spline of degree p with k control points to a polyline (n, 2).

    The polyline covers the spline's domain, from knot p to knot k, counted from 0.
    """
    degree, knots = entity.dxf.degree, np.array(entity.knots)
    control = np.array([tuple(point)[:2] for point in entity.control_points], dtype=np.float64)
    weights = np.array(entity.weights if len(entity.weights) else np.ones(len(control)))
    counted = len(knots) == len(control) + degree + 1 and (np.diff(knots) >= 0.0).all()
    sound = _sane(control, 1.0) and np.isfinite(knots).all() and (weights > 0.0).all()
    if not (counted and sound):
        raise ValueError("no spline")
    homogeneous = BSpline(knots, np.column_stack([control * weights[:, None], weights]), degree)

    def curve(parameters: Array) -> Array:
        values = homogeneous(parameters)
        return np.asarray(values[:, :2] / values[:, 2:])

    return _span_by_span(curve, np.unique(knots[degree : len(control) + 1]), tolerance)


def _closed_spline(entity: Spline, tolerance: float) -> Array:
    """The smooth closed curve through a spline's fit points, as a polyline (n, 2)."""
    points = np.array([tuple(point)[:2] for point in entity.fit_points], dtype=np.float64)
    if len(points) < 2 or not _sane(points, 1.0):
        raise ValueError("no spline")
    if np.hypot(*(points[0] - points[-1])) > tolerance:
        points = np.concatenate([points, points[:1]])
    points[-1] = points[0]
    knots = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    return _span_by_span(CubicSpline(knots, points, bc_type="periodic"), knots, tolerance)


def _span_by_span(curve: Callable[[Array], Array], knots: Array, tolerance: float) -> Array:
    """Converts a curve that is smooth between its knots to a polyline (n, 2), one span after the other."""
    spans = pairwise(knots.tolist())
    return np.concatenate([pieces.flattened(curve, tolerance, *span) for span in spans])


def _sane(points: Array, scale: float) -> bool:
    return bool(np.abs(points).max(initial=0.0) * scale <= pieces.LARGEST_MM)  # False for nan
