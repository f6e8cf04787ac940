"""Writes drawings for tests of the importers, and reads them."""

import ezdxf
import numpy as np
from refusals import refused_in_a_line

from planner.part import outline as outlines
from planner.part.importers.file import read_outline
from planner.part.importers.pieces import Options
from runtime.shell.errors import InputError

PLATE = [(0, 0), (40, 0), (40, 20), (0, 20)]
PLATE_MM2 = 800.0
SVG = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
MM = 'width="100mm" height="100mm" viewBox="0 0 100 100"'
"""An SVG page whose unit is a millimetre."""


def dxf(folder, draw, units=4):
    """Writes a DXF file with the drawing that `draw(model_space, document)` makes; returns its path."""
    document = ezdxf.new("R2010")
    document.units = units
    draw(document.modelspace(), document)
    path = folder / "part.dxf"
    document.saveas(path)
    return path


def svg(folder, body, size=MM, before=""):
    """Writes an SVG file; returns its path.

    Args:
        folder: folder of the file.
        body: elements of the drawing.
        size: attributes of the root element that state the size of the page.
        before: text before the root element.
    """
    path = folder / "part.svg"
    path.write_text(f"{before}<svg {SVG} {size}>{body}</svg>")
    return path


def read(path, **options):
    return read_outline(path, Options(**options))


def refused(path, match=None, error=InputError, **options):
    """Asserts that reading a drawing raises an error with a message of one line; returns the error."""
    with refused_in_a_line(error, match) as caught:
        read(path, **options)
    return caught.value


def area(part):
    return outlines.area(part.outline_mm)


def notes(part):
    return "; ".join(part.notes)


def lines(space, corners=PLATE, layer="0", close=True):
    """Draws each edge of a polygon as a LINE; without `close`, the last edge is missing."""
    for k in range(len(corners) - (not close)):
        ends = corners[k], corners[(k + 1) % len(corners)]
        space.add_line(*ends, dxfattribs={"layer": layer})


def box(space, low, high, **attributes):
    """Draws a rectangle as a closed polyline."""
    (x0, y0), (x1, y1) = low, high
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return space.add_lwpolyline(corners, close=True, dxfattribs=attributes)


def arc(centre, radius, first, last, count):
    """Returns points (count + 1, 2) on an arc from the angle `first` to the angle `last` [rad]."""
    angles = np.linspace(first, last, count + 1)
    return np.asarray(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
