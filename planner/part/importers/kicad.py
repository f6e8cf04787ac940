"""KiCad footprints: the component's body as drawn on the fabrication layer of a `.kicad_mod` file.

A footprint is one S-expression, read by sexpdata; the shapes of KiCad 5 (`module`) to 9 are known.
"""

import cmath
import math
import re
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple, TypeGuard

import numpy as np
import sexpdata
import shapely
from scipy.interpolate import BPoly

from planner.arrays import Array
from planner.part.importers import pieces
from runtime.shell.errors import InputError

BODY = "F.Fab"
ON_BODY = frozenset({BODY, "*.Fab", "F&B.Fab"})  # names of layers that hold the body
TEXTS = frozenset({"fp_text", "fp_text_box", "property"})
ROUNDS = 32  # chords of a rounded corner: error 3e-4 of its radius


class Expression(NamedTuple):
    """A list in a footprint's S-expression: its first element is its name, the others are its values."""

    name: str
    values: list[object]  # the further elements: words, texts, numbers and lists

    def children(self) -> list["Expression"]:
        """The non-empty lists among the values."""
        return [Expression(_word(value[0]), value[1:]) for value in self.values if _is_list(value)]

    def has(self, name: str) -> bool:
        """Whether there is a list called `name` among the values."""
        return any(child.name == name for child in self.children())

    def child(self, name: str) -> "Expression":
        """The first list called `name` among the values; raises `KeyError` if there is none."""
        return {child.name: child for child in reversed(self.children())}[name]

    def numbers(self, name: str, count: int) -> Array:
        """The first `count` numbers of the list called `name` among the values.

        Raises:
            KeyError: there is no such list.
            ValueError: see `first`.
        """
        return self.child(name).first(count)

    def first(self, count: int) -> Array:
        """The first `count` values as an array; raises `ValueError` if they are not finite numbers."""
        values = [value for value in self.values[:count] if isinstance(value, int | float)]
        if len(values) != count or not all(map(math.isfinite, values)):
            written = " ".join(map(str, (self.name, *self.values)))[:40]
            raise ValueError(f"{written!r} should hold {count} numbers")
        return np.array(values, dtype=np.float64)

    def layers(self) -> frozenset[str]:
        """The names of the layers that the list states."""
        stated = [part for part in self.children() if part.name in ("layer", "layers")]
        return frozenset(_word(value) for part in stated for value in part.values)


def read(data: bytes, options: pieces.Options) -> pieces.Pieces:
    """Returns the lines, arcs, circles, rectangles, polygons and curves of the body.

    The file's unit is the millimetre, unless the options state another.

    Raises:
        InputError: the file is not a footprint, one of its shapes is damaged, or it holds too many shapes or
            none on the layer of the body.
    """
    shapes = _shapes(data.decode("utf-8-sig", errors="replace"))
    if len(shapes) > pieces.MAX_SHAPES:
        raise pieces.too_much(f"holds more than {pieces.MAX_SHAPES} shapes")
    unit_mm, tolerance_mm = options.unit_mm or 1.0, options.chord_mm
    scale = np.array([1.0, -1.0]) * unit_mm  # the file's y axis points down
    curves, strays = list[Array](), Counter[str]()
    for shape in shapes:
        if not shape.layers() & ON_BODY or shape.name in TEXTS:
            continue
        draw = CURVES.get(shape.name)
        if draw is None:
            strays[shape.name] += 1
            continue
        try:
            curves.append(scale * draw(shape, tolerance_mm / unit_mm))
        except (KeyError, ValueError, IndexError) as error:
            problem = f"has a {shape.name} that cannot be read ({_reason(error)}); export it anew"
            raise InputError(problem) from error
    left_out = pieces.counted(strays)
    if not curves:
        raise _nothing(shapes, left_out)
    notes = [f"not known, ignored on {BODY}: {left_out}"] if strays else []
    return pieces.sorted_out(curves, 2.0 * tolerance_mm, notes)


def _shapes(text: str) -> list[Expression]:
    """Parses a footprint and returns its shapes and texts, which are the lists that state a layer."""
    if not re.match(r"\s*\((footprint|module)\b", text):
        raise InputError("is not a KiCad footprint; export one, or a DXF")
    try:
        footprint = sexpdata.loads(text, nil=None, true=None, line_comment="\0")
    except InputError:  # the time limit
        raise
    except Exception as error:  # the parser asserts, recurses and looks up attributes
        raise InputError("is a damaged KiCad footprint, or several; export one anew") from error
    return [part for part in Expression("", footprint).children() if part.layers()]


def _nothing(shapes: list[Expression], left_out: str) -> InputError:
    drawn = {layer for shape in shapes if shape.name in CURVES for layer in shape.layers()}
    others = f"it draws on {', '.join(sorted(drawn))}" if drawn else "it draws nothing at all"
    if left_out:
        others = f"what is there is not known: {left_out}"
    problem = f"has no shape on {BODY}, the layer of the body ({others})"
    return InputError(f"{problem}; draw the body's outline there")


def _is_list(value: object) -> TypeGuard[list[object]]:
    return isinstance(value, list) and bool(value)


def _word(value: object) -> str:
    return " ".join(str(value).split()) if isinstance(value, str | sexpdata.Symbol) else ""


def _reason(error: Exception) -> str:
    """The message of an error, shortened to one line."""
    if isinstance(error, KeyError):
        return f"no {error.args[0]}"
    return str(error).split("\n")[0][:120] or type(error).__name__


def _line(shape: Expression, _tolerance: float) -> Array:
    return np.array([shape.numbers("start", 2), shape.numbers("end", 2)])


def _rectangle(shape: Expression, _tolerance: float) -> Array:
    ends = np.sort([shape.numbers("start", 2), shape.numbers("end", 2)], axis=0)
    radius = float(shape.numbers("radius", 1)[0]) if shape.has("radius") else 0.0
    if radius > 0.5 * float(np.ptp(ends, axis=0).min()):
        raise ValueError(f"no corners of radius {radius:g} fit")
    box = shapely.box(*ends.ravel() + radius * np.array([1.0, 1.0, -1.0, -1.0]))
    if radius > 0.0:
        corners = shapely.multipoints(shapely.get_coordinates(box))
        box = shapely.convex_hull(shapely.buffer(corners, radius, quad_segs=ROUNDS))
    return np.asarray(shapely.get_coordinates(box))


def _circle(shape: Expression, tolerance: float) -> Array:
    return _arc(shape.numbers("center", 2), shape.numbers("end", 2), math.tau, tolerance)


def _bow(shape: Expression, tolerance: float) -> Array:
    """Converts an arc to a polyline (n, 2).

    A file states an arc by three points. Before KiCad 6 it states the arc's centre (`start`), one of its ends
    (`end`) and its angle.
    """
    start, end = shape.numbers("start", 2), shape.numbers("end", 2)
    if shape.has("angle"):
        return _arc(start, end, math.radians(float(shape.numbers("angle", 1)[0])), tolerance)
    return _through(start, shape.numbers("mid", 2), end, tolerance)


def _polygon(shape: Expression, tolerance: float) -> Array:
    """A closed polyline through points and arcs; the last point equals the first."""
    points = np.concatenate([_run(part, tolerance) for part in shape.child("pts").children()])
    return np.concatenate([points, points[:1]])


def _run(part: Expression, tolerance: float) -> Array:
    """Converts an element of a polygon to points: a vertex to (1, 2), an arc to a polyline (n, 2)."""
    if part.name == "xy":
        return part.first(2)[None]
    if part.name == "arc":
        return _bow(part, tolerance)
    raise ValueError(f"{part.name!r} is not known among its points")


def _bezier(shape: Expression, tolerance: float) -> Array:
    """Converts a cubic Bezier curve with four control points to a polyline (n, 2)."""
    control = np.concatenate([part.first(2)[None] for part in shape.child("pts").children()])
    if len(control) != 4:
        raise ValueError(f"{len(control)} points of 4")
    return pieces.flattened(BPoly(control[:, None], [0.0, 1.0]), tolerance)


CURVES: dict[str, Callable[[Expression, float], Array]] = {
    "fp_line": _line,
    "fp_rect": _rectangle,
    "fp_circle": _circle,
    "fp_arc": _bow,
    "fp_poly": _polygon,
    "fp_curve": _bezier,
}
"""Functions that convert each kind of shape to a polyline (n, 2), in the file's units."""


def _arc(centre: Array, start: Array, turn: float, tolerance: float) -> Array:
    x, y = start - centre

    def curve(share: Array) -> Array:
        c, s = np.cos(turn * share), np.sin(turn * share)
        return np.asarray(centre + np.column_stack([c * x - s * y, s * x + c * y]))

    return pieces.flattened(curve, tolerance)


def _through(start: Array, middle: Array, end: Array, tolerance: float) -> Array:
    """The arc through three points as a polyline (n, 2).

    The arc is a circle if its ends coincide, and a straight line if the three points lie on a line.
    """
    if np.array_equal(start, end):
        return _arc(0.5 * (start + middle), start, math.tau, tolerance)
    one, other = (complex(*(point - start)) for point in (middle, end))
    cross = (one.conjugate() * other).imag
    if abs(cross) <= 1e-9 * abs(other) ** 2:
        return np.array([start, end])
    to_centre = (abs(one) ** 2 * other - abs(other) ** 2 * one) / (2j * cross)
    turn, before = (cmath.phase(1.0 - chord / to_centre) % math.tau for chord in (other, one))
    centre = start + np.array([to_centre.real, to_centre.imag])
    points = _arc(centre, start, turn if before < turn else turn - math.tau, tolerance)
    return np.concatenate([points[:-1], end[None]])
