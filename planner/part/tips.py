"""Where fingertips squeeze a part, if nobody states it."""

import math

MARGIN_MM = 1.0
"""How far below the part's top the finger tips squeeze at least: the arm is off, a rim is rounded."""
HIGHEST_MM = 8.0  # Where the tips squeeze a part whose height nobody states, or a high one


def tips_height_mm(height_mm: float | None) -> float:
    """Height of the tips above the table: half-way up a part of that height, at most `HIGHEST_MM`."""
    top_mm = math.inf if height_mm is None else height_mm
    return min(HIGHEST_MM, 0.5 * top_mm, top_mm - MARGIN_MM)
