"""What the pictures share: colours that colour-blind readers tell apart, outlines, fingers, whole files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from planner.arrays import Array
from runtime.shell.files import writing

# Okabe and Ito's palette, and greys.
BLUE = "#0072B2"
RED = "#D55E00"
GREEN = "#009E73"
BLACK = "#1a1a1a"
GREY = "#a6a6a6"
PALE = "#d9d9d9"

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "axes.edgecolor": GREY,
    "xtick.color": "#595959",
    "ytick.color": "#595959",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.0,
    "ytick.major.size": 2.0,
    "svg.hashsalt": "squeezetree",  # ids of an SVG do not change from run to run
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}
DPI = 200
UNSIGNED = {
    ".png": {"Software": None},
    ".svg": {"Creator": None, "Date": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}
"""What to leave out of a file, by suffix, so that it does not change with the day."""
PICTURES = tuple(UNSIGNED)


@contextmanager
def style() -> Iterator[None]:
    """The look of all pictures, for as long as one is drawn and saved."""
    with mpl.rc_context(STYLE):
        yield


def save(path: Path, draw: Callable[[], Figure]) -> None:
    """Draws a figure and writes it in the format that the suffix names: the same bytes for the same figure.

    Args:
        path: ends in one of `PICTURES`.
        draw: makes the figure.
    """
    with style(), writing(path) as file:
        draw().savefig(file, dpi=DPI, metadata=UNSIGNED[path.suffix.lower()])


def polygons(
    axes: Axes, shapes: Sequence[Array] | Array, colour: str, width: float, order: float = 2.0,
    fill: float = 0.0, edge: float = 1.0,
) -> None:  # fmt: skip
    """Draws closed polygons; the limits of the axes stay.

    Args:
        axes: where.
        shapes: n of them, each (N, 2) [mm].
        colour: of edges and faces.
        width: of the edges [points].
        order: greater ones are drawn over lesser ones.
        fill: opacity of the faces.
        edge: opacity of the edges.
    """
    faces = to_rgba(colour, fill) if fill else "none"
    drawn = PolyCollection(
        list(shapes), linewidths=width, zorder=order, facecolors=faces, edgecolors=to_rgba(colour, edge)
    )
    axes.add_collection(drawn, autolim=False)


def outlines(outline: Array, poses: Array) -> Array:
    """The part at each of the poses.

    Args:
        outline: (N, 2) in the part's frame [mm].
        poses: (n, 3) [mm, mm, rad].

    Returns:
        (n, N, 2) [mm].
    """
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)  # (n, 2, 2)
    return np.asarray(np.einsum("nij,kj->nki", turn, outline) + poses[:, None, :2])


def finger_boxes(jaws: Array, width_mm: float) -> Array:
    """Both fingers, closed to a width, in the hand frame.

    Args:
        jaws: (4,) opening, finger length, finger thickness [mm], the upper finger's share of the closing.
        width_mm: between the inner faces.

    Returns:
        (2, 4, 2) the upper and the lower box [mm].
    """
    opening, length, thickness, share = jaws
    top = 0.5 * opening - share * (opening - width_mm)
    x = 0.5 * length * np.array([-1.0, 1.0, 1.0, -1.0])
    y = thickness * np.array([0.0, 0.0, 1.0, 1.0])
    return np.stack([np.stack([x, top + y], axis=-1), np.stack([x, top - width_mm - y], axis=-1)])
