"""Reads CSV outlines: one vertex a line, in two columns; a header such as `x_mm,y_mm` names the unit."""

import math
import re

import numpy as np

from planner.part.importers.pieces import UNITS_MM, Options, Pieces, need_units, sorted_out
from runtime.shell.errors import InputError

MAX_ROWS = 100_000
HEADER = re.compile(r"[\"']?([xy])(?:[_ \[(]+(mm|cm|in|m)[\])]?)?[\"']?", re.IGNORECASE)


def read(data: bytes, options: Options) -> Pieces:
    """Returns the single ring of a CSV file; see `dxf.read`.

    Columns are separated by commas, semicolons (then a comma may be the decimal sign), tabs or spaces; lines
    that begin with # are skipped.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("not UTF-8 text; save it as CSV") from error
    numbered = ((k, line.strip()) for k, line in enumerate(text.splitlines(), 1))
    lines = [(k, line) for k, line in numbered if line and not line.startswith("#")]
    rows = [(k, _cells(line)) for k, line in lines]
    if len(rows) > MAX_ROWS:
        raise InputError(f"has {len(rows)} lines; an outline has at most {MAX_ROWS}")
    stated = None
    names = re.split(r"[,;\t]", lines[0][1]) if lines else []
    columns = [column for name in names if (column := HEADER.fullmatch(name.strip()))]
    if columns and columns[0][1] in "xX":
        named = {column[2].lower() for column in columns if column[2]}
        if len(named) > 1:
            problem = f"its columns have different units ({', '.join(sorted(named))}); convert one"
            raise InputError(problem)
        stated = UNITS_MM[named.pop()] if named else None
        rows = rows[1:]
    scale = options.unit_mm if options.unit_mm is not None else stated
    if scale is None:
        raise need_units("does not name its unit (a header x_mm,y_mm would)")
    notes = []
    if stated not in (None, scale):
        notes.append("the header names another unit, overruled by --units")
    points = np.array([_vertex(cells, line) for line, cells in rows]).reshape(-1, 2) * scale
    closed = np.concatenate([points, points[:1]])
    if len(points) > 1 and np.hypot(*(points[0] - points[-1])) <= options.chord_mm:
        closed = points
    return sorted_out([closed] if len(closed) > 3 else [], options.chord_mm, notes)


def _cells(line: str) -> list[str]:
    if ";" in line:
        return [cell.strip().replace(",", ".") for cell in line.split(";")]
    return [cell for cell in re.split(r"\s*,\s*|\s+", line) if cell]


def _vertex(cells: list[str], line: int) -> tuple[float, float]:
    try:
        plain = len(cells) == 2 and not any("_" in cell for cell in cells)  # 1_0 is 10 for Python
        x, y = map(float, cells) if plain else (math.nan, math.nan)
    except ValueError:
        x = y = math.nan
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InputError(f"line {line} is not two numbers, x and y; write one vertex a line")
    return x, y
