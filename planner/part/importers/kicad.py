"""KiCad footprints: the component's body, as the fabrication layer of a `.kicad_mod` file draws it."""

import math
import re

import numpy as np

from planner.arrays import Array
from planner.errors import InputFileError
from planner.part.importers.pieces import MAX_SHAPES, Pieces, flattened, sorted_out, too_much

LAYER = re.compile(r'\(layer "?F\.Fab"?\)')
POINT = re.compile(r"\((start|mid|end|center|xy) (\S+?) (\S+?)\)")
ANGLE = re.compile(r"\(angle (\S+?)\)")


def read(data: bytes, where: str, unit_mm: float | None, tolerance_mm: float) -> Pieces:
    """The body's lines, arcs, circles, rectangles and polygons; millimetres, unless told otherwise.

    Raises:
        InputFileError: it is not a footprint.
        OutlineError: it holds more shapes than any body has.
    """
    text = data.decode("utf-8", errors="replace")
    if not re.match(r"\s*\((footprint|module)\b", text):
        raise InputFileError("is not a KiCad footprint; export one, or a DXF", where=where)
    shapes = text.split("(fp_")[1:]
    if len(shapes) > MAX_SHAPES:
        raise too_much(where, f"holds more than {MAX_SHAPES} shapes")
    scale = np.array([1.0, -1.0]) * (unit_mm or 1.0)  # the file's y axis points down
    try:
        curves = [scale * _curve(shape, tolerance_mm) for shape in shapes if _drawn(shape)]
    except (KeyError, ValueError, IndexError) as error:
        problem = f"has a shape that cannot be read ({error}); export it anew"
        raise InputFileError(problem, where=where) from error
    return sorted_out(curves, 2.0 * tolerance_mm, where, [])


def _drawn(shape: str) -> bool:
    return not shape.startswith("text") and LAYER.search(shape) is not None


def _curve(shape: str, tolerance: float) -> Array:
    found = [(name, (float(x), float(y))) for name, x, y in POINT.findall(shape)]
    at = {name: np.array(point) for name, point in found}
    kind = shape.split(None, 1)[0]
    if kind == "poly":
        corners = np.array([point for name, point in found if name == "xy"])
        return np.concatenate([corners, corners[:1]])
    if kind == "rect":
        (x0, y0), (x1, y1) = at["start"], at["end"]
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    if kind == "circle":
        return _arc(at["center"], at["end"], math.tau, tolerance)
    if kind == "arc":
        if turn := ANGLE.search(shape):  # as before version 6: the centre, an end and the angle
            return _arc(at["start"], at["end"], math.radians(float(turn[1])), tolerance)
        return _through(at["start"], at["mid"], at["end"], tolerance)
    return np.array([at["start"], at["end"]])


def _arc(centre: Array, start: Array, turn: float, tolerance: float) -> Array:
    x, y = start - centre

    def curve(share: Array) -> Array:
        c, s = np.cos(turn * share), np.sin(turn * share)
        return np.asarray(centre + np.column_stack([c * x - s * y, s * x + c * y]))

    return flattened(curve, tolerance)


def _through(start: Array, middle: Array, end: Array, tolerance: float) -> Array:
    """The arc through three points; their straight line where they lie on one."""
    one, other = middle - start, end - start
    cross = one[0] * other[1] - one[1] * other[0]
    if abs(cross) <= 1e-9 * float(other @ other):
        return np.array([start, end])
    offset = np.array(
        [other[1] * (one @ one) - one[1] * (other @ other), one[0] * (other @ other) - other[0] * (one @ one)]
    )
    centre = start + offset / (2.0 * cross)
    first, last = (math.atan2(*(point - centre)[::-1]) for point in (start, end))
    turn = (last - first) % math.tau
    passes = (math.atan2(*(middle - centre)[::-1]) - first) % math.tau < turn
    return np.concatenate(
        [_arc(centre, start, turn if passes else turn - math.tau, tolerance)[:-1], end[None]]
    )
