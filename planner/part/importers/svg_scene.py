"""Finds the visible shapes of an SVG drawing: walks the tree as a viewer does, and expands copies (`use`).

Definitions (`defs`, `symbol`, `marker`, `mask`, `clipPath`, `pattern`) show only where a copy places them.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from planner.arrays import Array
from planner.part.importers import pieces
from planner.part.importers.svg_shapes import SHAPES
from planner.part.importers.svg_style import INHERITED, Sheets, Style
from planner.part.importers.svg_values import Values, Viewport
from runtime.shell.errors import InputError

MAX_DEPTH = 100
WIDE_MM = 1.0  # a wider stroke is noted: half its width is more than a step of most encoders
XLINK = "{http://www.w3.org/1999/xlink}href"
SIZES = ("width", "height")
GROUPS = frozenset({"svg", "g", "a", "switch", "use"})
STRAYS = frozenset({"text", "image", "foreignObject"})
CONDITIONS = ("requiredExtensions", "systemLanguage")  # attributes for which `switch` skips a child


class Shape(NamedTuple):
    """A visible shape of an SVG drawing, with its attributes, transform and visible window."""

    kind: str  # one of `SHAPES`
    values: Values
    matrix: Array  # (3, 3) from the user units of the shape to the drawing's
    window: shapely.Geometry | None  # visible window in the drawing's user units; None: all


class Frame(NamedTuple):
    """Properties that an element inherits from the elements around it."""

    matrix: Array  # (3, 3) see `Shape`
    style: Style
    viewport: Viewport
    window: shapely.Geometry | None = None  # see `Shape`
    above: tuple[int, ...] = ()  # ids of the elements around it


class Scene:
    """The shapes of a drawing, and counts of its other elements."""

    def __init__(self, root: Element, sheets: Sheets, viewport: Viewport, unit_mm: float) -> None:
        self.unseen = 0  # elements that are hidden, transparent or without paint
        self.cut = 0  # elements that a clip path, mask or viewport cuts
        self.strays = Counter[str]()  # visible elements that are no outlines, by kind
        self.widest_mm = 0.0  # width of the widest visible stroke
        self.missing: list[str] = []  # links of copies whose target the file lacks
        self._root, self._viewport, self._unit_mm = root, viewport, unit_mm
        self._namespace = str(root.tag).rpartition("}")[0]
        self._sheets = sheets
        self._named: dict[str, Element] = {}
        for element in root.iter():
            self._named.setdefault(element.get("id", ""), element)
        self._elements = 0

    def shapes(self) -> Iterator[Shape]:
        """The visible shapes, in drawing order.

        Raises:
            InputError: an attribute is malformed, there are too many elements, or an element contains itself.
        """
        return self._draw(self._root, Frame(np.eye(3), INHERITED, self._viewport), None)

    def notes(self) -> list[str]:
        """Notes on the elements that are left out, cut, or drawn with wide strokes, one sentence each."""
        notes = []
        if self.unseen:
            why = "hidden, transparent, out of sight, or neither filled nor stroked"
            notes.append(f"not seen ({why}), left out: {self.unseen} of its elements")
        if self.cut:
            whole = f"taken whole: {self.cut} of its elements"
            notes.append(f"cut by clip paths, masks or viewports, {whole}")
        if self.widest_mm > WIDE_MM:
            wide = f"strokes up to {self.widest_mm:.4g} mm wide"
            notes.append(f"{wide}; the outline runs along their middle")
        if self.strays:
            notes.append(f"not outlines, ignored: {pieces.counted(self.strays)}")
        if self.missing:
            notes.append(f"copied, but not in the file: {', '.join(dict.fromkeys(self.missing))}")
        return notes

    def _draw(self, element: Element, around: Frame, copy: Values | None) -> Iterator[Shape]:
        """Yields the shapes of one element; `copy` is the `use` element that places it, or None."""
        kind = self._kind(element)
        if not (kind in SHAPES or kind in GROUPS or kind in STRAYS or (kind == "symbol" and copy)):
            return
        self._count(element, around)
        name = f" {element.get('id')!r}" if element.get("id") else ""
        style = self._sheets.style(element, around.style)
        values = Values(style, around.viewport, self._unit_mm, f"<{kind}>{name}")
        if not values.shows():
            self.unseen += 1
            return
        if kind in STRAYS:
            self.strays[kind] += 1
            return
        self.cut += any(style.get(name, "none").strip() != "none" for name in ("clip-path", "mask"))
        matrix = around.matrix @ values.transform()
        frame = Frame(matrix, style, around.viewport, around.window, (*around.above, id(element)))
        if kind in SHAPES:
            width = values.size("stroke-width")
            if values.paints(width):
                if values.strokes(width):
                    width_mm = width * self._unit_mm * float(np.linalg.norm(matrix[:2, :2], 2))
                    self.widest_mm = max(self.widest_mm, width_mm)
                yield Shape(kind, values, matrix, around.window)
            else:
                self.unseen += 1
        elif kind == "use":
            yield from self._copy(element, frame, values)
        else:
            inside = frame if element is self._root else self._viewed(kind, frame, values, copy)
            if inside is not None:
                for child in self._children(element):
                    yield from self._draw(child, inside, None)

    def _copy(self, element: Element, frame: Frame, values: Values) -> Iterator[Shape]:
        link = (element.get("href") or element.get(XLINK) or "").strip()
        target = self._named.get(link[1:]) if link.startswith("#") and link != "#" else None
        if target is None:
            self.missing.append(link or "<use> without href")
            return
        place = np.eye(3)
        place[:2, 2] = values.at("x"), values.at("y")
        yield from self._draw(target, frame._replace(matrix=frame.matrix @ place), values)

    def _viewed(self, kind: str, frame: Frame, values: Values, copy: Values | None) -> Frame | None:
        """The properties that the content of a group inherits; None if the group has no extent."""
        if kind not in ("svg", "symbol"):
            return frame
        texts = {name: (copy and copy.style.get(name)) or values.style.get(name) for name in SIZES}
        sizes = {
            name: text if text and text.strip() != "auto" else "100%"
            for name, text in texts.items()
        }
        values = values._replace(style={**values.style, **sizes})
        box = values.box()
        known = None not in frame.viewport
        stated = [name for name in SIZES if known or "%" not in sizes[name]]
        size = Viewport(*(values.size(name) if name in stated else None for name in SIZES))
        if 0.0 in size or (box is not None and 0.0 in box[2:]):
            return None
        window = self._window(frame, values, size)
        place = np.eye(3)
        place[:2, 2] = values.at("x"), values.at("y")
        fit = place if box is None else values.fitted(box, size)
        inner = size if box is None else Viewport(*box[2:])
        return frame._replace(matrix=frame.matrix @ fit, viewport=inner, window=window)

    def _window(self, frame: Frame, values: Values, size: Viewport) -> shapely.Geometry | None:
        """The part of the drawing that the viewport of an element and all viewports around it leave visible.

        None: everything is visible.
        """
        width, height = size
        overflow = values.style.get("overflow", "hidden").split()
        if width is None or height is None or "visible" in overflow or "auto" in overflow:
            return frame.window
        x, y = values.at("x"), values.at("y")
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        window = shapely.polygons(corners @ frame.matrix[:2, :2].T + frame.matrix[:2, 2])
        return window if frame.window is None else shapely.intersection(window, frame.window)

    def _children(self, element: Element) -> Iterable[Element]:
        if self._kind(element) != "switch":
            return element
        free = (child for child in element if not any(child.get(name) for name in CONDITIONS))
        return [child for child in free if self._kind(child) in GROUPS | SHAPES | STRAYS][:1]

    def _count(self, element: Element, around: Frame) -> None:
        if id(element) in around.above or len(around.above) > MAX_DEPTH:
            raise InputError("is nested too deeply, or in itself; export it again")
        self._elements += 1
        if self._elements > pieces.MAX_SHAPES:
            shapes = f"{pieces.MAX_SHAPES} shapes, its copies written out"
            raise pieces.too_much(f"draws more than {shapes}")

    def _kind(self, element: Element) -> str:
        """The name of an element without its namespace; "" if this namespace is not that of the root."""
        namespace, _, name = str(element.tag).rpartition("}")
        return name if namespace == self._namespace else ""
