"""What the pictures of a table say at its panels and branches."""

from __future__ import annotations

import numpy as np

from planner.report import canvas
from runtime.table import Branch, Leaf

DIM = "#6b6b6b"


def interval(branch: Branch) -> str:
    """The widths of a branch."""
    return f"{branch.low_um / 1e3:.1f}\N{EN DASH}{branch.high_um / 1e3:.1f}"


def leaf_lines(leaf: Leaf, order: int) -> list[tuple[str, str]]:
    """What is written at a leaf of a part of this rotational order, each line with its colour."""
    angle = round(float(np.degrees(leaf.theta_urad / 1e6)), 1) % (360.0 / order)
    place = f"{signed(leaf.x_um / 1e3)}, {signed(leaf.y_um / 1e3)}"
    lines = [(place, canvas.BLACK), (f"{angle:.1f}°", canvas.BLACK)]
    if not leaf.resolved:
        lines = [("not", canvas.BLACK), ("resolved", canvas.BLACK)]
    if leaf.success is None:
        return [*lines, ("untried", DIM)]
    lines.append((f"{100 * leaf.success:.1f} %", canvas.GREEN if leaf.resolved else DIM))
    return [*lines, (f"of {leaf.trials}", DIM)]


def degrees(angle: float) -> str:
    """Whole degrees, with a minus sign of the right length."""
    return f"{angle:.0f}°".replace("-", "\N{MINUS SIGN}")


def percent(share: float) -> str:
    """A share of all parts, with a digit more where it is small."""
    if 0.0 < share < 0.001:
        return "< 0.1 %"
    return f"{100 * share:.1f} %" if share < 0.0995 else f"{100 * share:.0f} %"


def signed(value: float) -> str:
    """One decimal, with a minus sign of the right length and no negative zero."""
    return f"{round(value, 1) + 0.0:.1f}".replace("-", "\N{MINUS SIGN}")
