"""The smallest rectangle that encloses an outline, and how it is turned in the drawing."""

import math
from typing import NamedTuple

import numpy as np
import shapely

from planner.part.outline import Outline

LEAST_TURN_DEG = 0.05  # below, a drawing is called straight


class Rectangle(NamedTuple):
    """A rectangle about an outline."""

    length_mm: float  # its longer side
    width_mm: float  # its shorter side
    turn_deg: float  # of the longer side from x, in (-90, 90]

    def text(self) -> str:
        """For people: the sides, and the turn if there is one."""
        turned = min(abs(self.turn_deg), 90.0 - abs(self.turn_deg)) > LEAST_TURN_DEG
        sides = f"{self.length_mm:.1f} x {self.width_mm:.1f} mm"
        return sides + (f", turned by {self.turn_deg:.3g} degrees in the drawing" if turned else "")


def smallest_rectangle(outline: Outline) -> Rectangle:
    """The rectangle of least area about an outline (N, 2) [mm]."""
    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.multipoints(outline)))[:3]
    sides = np.diff(corners, axis=0)
    (dx, dy), (length, width) = sides[0], np.hypot(*sides.T)
    if length < width:
        (dx, dy), length, width = sides[1], width, length
    turn = -math.remainder(-math.degrees(math.atan2(dy, dx)), 180.0)
    return Rectangle(float(length), float(width), turn)
