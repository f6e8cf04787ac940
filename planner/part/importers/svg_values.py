"""Parses SVG attributes: lengths, lists, transforms, view boxes, opacities; refuses malformed ones."""

import math
import re
from typing import NamedTuple

import numpy as np
import svgelements
from tinycss2.color4 import parse_color

from planner.arrays import Array
from planner.part.importers.svg_style import Style
from runtime.shell.errors import InputError

NUMBER = r"(?>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
GAP = r"(?>\s*,?\s*)"
LENGTH = re.compile(rf"\s*({NUMBER})\s*(mm|cm|in|pt|pc|Q|px|%)?\s*", re.IGNORECASE)
SHARE = re.compile(rf"\s*({NUMBER})\s*%?\s*")
APART = r"(?!\.)"  # 1.1.1 is two numbers in a path only
LIST = re.compile(rf"\s*(?:{NUMBER}{APART}{GAP})*")
CALL = rf"([a-zA-Z]+)\s*\(\s*((?:{NUMBER}{APART}(?:px|deg|grad|rad|turn)?{GAP})*)\)"
CALLS = re.compile(rf"\s*(?:{CALL}{GAP})*")
PHYSICAL_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "pt": 25.4 / 72, "pc": 25.4 / 6, "q": 0.25}
PIXEL_MM = 25.4 / 96  # size of a CSS pixel: the user unit without a view box
ARGUMENTS = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3)}
ARGUMENTS |= dict.fromkeys(("translatex", "translatey", "scalex", "scaley"), (1,))
ARGUMENTS |= {"skewx": (1,), "skewy": (1,)}
# Attributes whose percentages refer to the width of the viewport.
ACROSS = frozenset({"x", "cx", "rx", "x1", "x2", "width"})
# Attributes whose percentages refer to the height of the viewport.
ALONG = frozenset({"y", "cy", "ry", "y1", "y2", "height"})
PLACES = ACROSS | ALONG | {"r"}
EDGES = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}
ASPECT = re.compile(
    r"\s*(?:defer\s+)?(none|x(?:Min|Mid|Max)Y(?:Min|Mid|Max))(?:\s+(meet|slice))?\s*"
)


class Viewport(NamedTuple):
    """The size of the window to which percentages refer, in user units; None: unknown."""

    width: float | None
    height: float | None


class Length(NamedTuple):
    """A length as written in an attribute: a number and its unit."""

    value: float
    unit: str  # lower case; empty for user units


def is_physical(name: str, text: str) -> bool:
    """Whether the attribute `name` is a size or position, and `text` a length in a physical unit."""
    parts = LENGTH.fullmatch(text) if name in PLACES else None
    return parts is not None and (parts[2] or "").lower() in PHYSICAL_MM


class Values(NamedTuple):
    """The attributes of one element, as numbers in user units."""

    style: Style
    viewport: Viewport
    unit_mm: float  # size of one user unit of the whole drawing
    element: str  # name of the element, for errors

    def stated(self, name: str) -> Length | None:
        """The length `name` as written; None if it is not stated, or `auto`.

        Raises:
            InputError: the length is malformed.
        """
        text = self.style.get(name, "").strip()
        if text in ("auto", ""):
            return None
        parts = LENGTH.fullmatch(text)
        if parts is None or not math.isfinite(float(parts[1])):
            raise self.error(name, "is no length in mm, cm, in, pt, pc, Q, px, % or user units")
        return Length(float(parts[1]), (parts[2] or "").lower())

    def length(self, name: str) -> float | None:
        """The length `name` in user units; None if it is not stated, or `auto`.

        Raises:
            InputError: the length is malformed, or a percentage of an unknown size.
        """
        stated = self.stated(name)
        if stated is None:
            return None
        if stated.unit != "%":
            return stated.value * PHYSICAL_MM.get(stated.unit, self.unit_mm) / self.unit_mm
        width, height = self.viewport
        if name in ACROSS or name in ALONG:
            whole = width if name in ACROSS else height
        elif width is None or height is None:
            whole = None
        else:
            whole = math.hypot(width, height) / math.sqrt(2.0)
        if whole is None:
            raise self.error(name, "is a share of a size that the file does not state")
        return 0.01 * stated.value * whole

    def size(self, name: str) -> float:
        """The length `name`, 0 if it is not stated; raises `InputError` if it is negative."""
        value = self.length(name) or 0.0
        if value < 0.0:
            raise self.error(name, "is negative")
        return value

    def at(self, name: str) -> float:
        """The coordinate `name` in user units, 0 if it is not stated."""
        return self.length(name) or 0.0

    def numbers(self, name: str) -> list[float]:
        """The numbers that the attribute `name` lists, without units."""
        text = self.style.get(name, "")
        if not LIST.fullmatch(text):
            raise self.error(name, "is no list of numbers")
        return [float(number) for number in re.findall(NUMBER, text)]

    def transform(self) -> Array:
        """The transform (3, 3) that the element states, for columns (x, y, 1)."""
        for name in ("translate", "rotate", "scale"):
            if self.style.get(name, "none").strip() != "none":
                raise self.error(name, "is not read, but transform is")
        text = self.style.get("transform", "none").strip()
        if text in ("none", ""):
            return np.eye(3)
        calls = re.findall(CALL, text) if CALLS.fullmatch(text) else [("", "")]
        counts = ((name.lower(), len(re.findall(NUMBER, inside))) for name, inside in calls)
        if not all(count in ARGUMENTS.get(name, ()) for name, count in counts):
            raise self.error("transform", "is no transform")
        matrix = _array(svgelements.Matrix(text))
        origin = np.eye(3)
        origin[:2, 2] = self._origin()
        return np.asarray(origin @ matrix @ np.linalg.inv(origin))

    def box(self) -> list[float] | None:
        """The view box: least x and y, width and height; None if the element has none."""
        if not self.style.get("viewBox", "").strip():
            return None
        box = self.numbers("viewBox")
        if len(box) != 4 or min(box[2:]) < 0.0:
            raise self.error("viewBox", "is no view box of four numbers")
        return box

    def fitted(self, box: list[float], size: Viewport) -> Array:
        """The transform (3, 3) that fits a view box into a viewport at the element's x and y."""
        if size.width is None or size.height is None:
            raise self.error("viewBox", "is drawn at a size that the file does not state")
        aspect = ASPECT.fullmatch(self.style.get("preserveAspectRatio", ""))
        how = f"{aspect[1]} {aspect[2] or 'meet'}" if aspect else None
        place = self.at("x"), self.at("y"), size.width, size.height
        return _array(svgelements.Matrix(svgelements.Viewbox.viewbox_transform(*place, *box, how)))

    def error(self, name: str, problem: str) -> InputError:
        """An error that states an attribute, its value, and what is wrong with the value."""
        text = " ".join(self.style.get(name, "").split())
        text = text if len(text) <= 40 else f"{text[:37]}..."
        problem = f'{name}="{text}" {problem}; correct it in the drawing'
        return InputError(problem, key=self.element)

    def shows(self) -> bool:
        """Whether an element and its content are displayed."""
        return self._word("display") != "none" and self._is_opaque("opacity")

    def paints(self, stroke_width: float) -> bool:
        """Whether a shape is visible, and filled or stroked with some colour."""
        inked = self._inks("fill") or self.strokes(stroke_width)
        return self._word("visibility") == "visible" and inked

    def strokes(self, stroke_width: float) -> bool:
        """Whether a shape is stroked with some colour, even if the shape is not visible."""
        return stroke_width > 0.0 and self._inks("stroke")

    def _inks(self, what: str) -> bool:
        paint = self._word(what)
        if paint == "currentcolor":
            paint = self._word("color")
        clear = getattr(parse_color(paint), "alpha", 1.0) == 0.0
        return paint != "none" and not clear and self._is_opaque(f"{what}-opacity")

    def _word(self, name: str) -> str:
        """The value of a property in lower case; raises `InputError` for a CSS variable."""
        text = self.style.get(name, "").strip()
        if "var(" in text:
            raise self.error(name, "is a variable, which is not read")
        return text.lower()

    def _is_opaque(self, name: str) -> bool:
        share = SHARE.fullmatch(self.style.get(name) or "1")
        if share is None:
            raise self.error(name, "is no number")
        return float(share[1]) > 0.0

    def _origin(self) -> tuple[float, float]:
        words = self.style.get("transform-origin", "").split()[:2]
        if not words:
            return 0.0, 0.0
        if self.style.get("transform-box", "view-box").strip() != "view-box":
            raise self.error("transform-box", "is not read")
        if words[0] in ("top", "bottom") or (len(words) > 1 and words[1] in ("left", "right")):
            words.reverse()
        words = [EDGES.get(word, word) for word in (*words, "center")]
        placed = self._replace(style={"x": words[0], "y": words[1]})
        return placed.at("x"), placed.at("y")


def _array(m: svgelements.Matrix) -> Array:
    return np.array([[m.a, m.c, m.e], [m.b, m.d, m.f], [0.0, 0.0, 1.0]])
