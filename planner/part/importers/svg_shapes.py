"""The basic shapes and paths of SVG as polylines; svgelements computes the curves."""

import re
from functools import partial

import numpy as np
import svgelements

from planner.arrays import Array
from planner.part.importers import pieces
from planner.part.importers.svg_values import GAP, NUMBER, Values
from runtime.shell.errors import InputError

SHAPES = frozenset({"path", "rect", "circle", "ellipse", "line", "polyline", "polygon"})


def _command(letters: str, *arguments: str) -> str:
    return rf"[{letters}]\s*(?:{GAP.join((*arguments, ''))})+"


FLAG = "[01]"
COMMANDS = (
    _command("MmLlTt", *[NUMBER] * 2),
    _command("HhVv", NUMBER),
    _command("Cc", *[NUMBER] * 6),
    _command("SsQq", *[NUMBER] * 4),
    _command("Aa", *[NUMBER] * 3, FLAG, FLAG, *[NUMBER] * 2),
    "[Zz]",
)
PATH = re.compile(rf"\s*(?:(?=[Mm])(?:(?>{'|'.join(COMMANDS)})\s*)+)?")


def polylines(kind: str, values: Values, tolerance: float) -> list[Array]:
    """A shape as polylines, each (n, 2), in its own user units, with chords within a tolerance.

    Raises:
        InputError: an attribute is malformed, or a coordinate is not finite or absurdly large.
    """
    if kind == "line":
        ends = [[values.at("x1"), values.at("y1")], [values.at("x2"), values.at("y2")]]
        return [np.array(ends, dtype=np.float64)]
    if kind in ("polyline", "polygon"):
        numbers = values.numbers("points")
        if len(numbers) % 2:
            raise values.error("points", "has an x without a y")
        points = np.array(numbers, dtype=np.float64).reshape(-1, 2)
        return [np.concatenate([points, points[:1]]) if kind == "polygon" else points]
    path = _path(kind, values)
    return [_polyline(part, tolerance, values) for part in (path.as_subpaths() if path else ())]


def _path(kind: str, values: Values) -> svgelements.Path | None:
    """Converts a shape to a path; None if the shape has no extent, since SVG does not draw it."""
    if kind == "path":
        text = values.style.get("d", "")
        if not PATH.fullmatch(text):
            end = PATH.match(text)
            off = " ".join(text[end.end() if end else 0 :].split())[:20]
            raise values.error("d", f"is no path data from {off!r} on")
        return svgelements.Path(text)
    if kind == "rect":
        width, height = values.size("width"), values.size("height")
        radii = {name: value for name in ("rx", "ry") if (value := values.length(name)) is not None}
        rect = svgelements.Rect(values.at("x"), values.at("y"), width, height, **radii)
        return svgelements.Path(rect) if width * height else None
    if kind == "circle":
        rx = ry = values.size("r")
    else:
        x, y = values.length("rx"), values.length("ry")
        rx, ry = (x if x is not None else y) or 0.0, (y if y is not None else x) or 0.0
    ellipse = svgelements.Ellipse(values.at("cx"), values.at("cy"), rx, ry)
    return svgelements.Path(ellipse) if rx * ry else None


def _polyline(part: svgelements.Subpath, tolerance: float, values: Values) -> Array:
    points: list[Array] = []
    for segment in part:
        if isinstance(segment, svgelements.Move) or segment.start is None or segment.end is None:
            continue
        if isinstance(segment, svgelements.Line | svgelements.Close):
            ends = [(segment.start.x, segment.start.y), (segment.end.x, segment.end.y)]
            points.append(np.array(ends, dtype=np.float64))
            continue
        coarse = _at(segment, np.linspace(0.0, 1.0, 9))
        if not np.abs(coarse).max() <= pieces.LARGEST_MM / tolerance * 0.02:  # also of nan
            problem = "has a coordinate that is not finite or absurdly large; repair the drawing"
            raise InputError(problem, key=values.element)
        points.append(pieces.flattened(partial(_at, segment), tolerance))
    if not points:
        return np.empty((0, 2))
    every = np.concatenate(points)
    fresh = np.ones(len(every), np.bool_)
    fresh[1:] = np.any(every[1:] != every[:-1], axis=1)
    return np.asarray(every[fresh])


def _at(segment: svgelements.PathSegment, parameters: Array) -> Array:
    points = map(segment.point, parameters)
    return np.array([(point.x, point.y) for point in points], dtype=np.float64)
