"""Default height at which fingertips squeeze a part."""

import math

MARGIN_MM = 1.0
"""Least depth of the finger tips below the part's top: the arm has errors, and a rim may be rounded."""
HIGHEST_MM = 8.0  # Height of the tips above the table for a part of unknown height, or a high part


def tips_height_mm(height_mm: float | None) -> float:
    """Height of the tips above the table: half the part's height `height_mm`, within two limits.

    The tips are at most `HIGHEST_MM` high, and at least `MARGIN_MM` below the part's top. So the result is
    negative for a part thinner than `MARGIN_MM`. For a part of unknown height (None) the result is
    `HIGHEST_MM`.
    """
    top_mm = math.inf if height_mm is None else height_mm
    return min(HIGHEST_MM, 0.5 * top_mm, top_mm - MARGIN_MM)
