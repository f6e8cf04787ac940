"""Drawings for tests of the importers, made by ezdxf, and what becomes of them."""

import ezdxf
import numpy as np

from planner.part import outline as outlines
from planner.part.importers.file import read_outline
from planner.part.importers.pieces import Options

PLATE = [(0, 0), (40, 0), (40, 20), (0, 20)]
PLATE_MM2 = 800.0


def dxf(folder, draw, units=4):
    """A file in which `draw(model_space, document)` has drawn."""
    document = ezdxf.new("R2010")
    document.units = units
    draw(document.modelspace(), document)
    path = folder / "part.dxf"
    document.saveas(path)
    return path


def read(path, **options):
    return read_outline(path, Options(**options))


def area(part):
    return outlines.area(part.outline_mm)


def notes(part):
    return "; ".join(part.notes)


def lines(space, corners=PLATE, layer="0", close=True):
    """Each edge as a LINE."""
    for k in range(len(corners) - (not close)):
        ends = corners[k], corners[(k + 1) % len(corners)]
        space.add_line(*ends, dxfattribs={"layer": layer})


def box(space, low, high, **attributes):
    """A closed polyline."""
    (x0, y0), (x1, y1) = low, high
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return space.add_lwpolyline(corners, close=True, dxfattribs=attributes)


def arc(centre, radius, first, last, count):
    """Points (count + 1, 2) of an arc, from one angle to another [rad]."""
    angles = np.linspace(first, last, count + 1)
    return np.asarray(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])
