"""Shared elements of pictures: colours for colour-blind readers, outlines, fingers, files."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from jinja2 import Template
from matplotlib import style as mpl_style
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.frames import to_world
from planner.mechanics.clearance import Jaws
from planner.templating import environment
from runtime.shell.files import writing

# Okabe and Ito's palette, and greys.
BLUE = "#0072B2"
RED = "#D55E00"
BLACK = "#1a1a1a"
GREY = "#a6a6a6"
PALE = "#d9d9d9"

TEMPLATES = Path(__file__).parent / "templates"
DPI = 200
OUTLINES = 60  # most outlines of one belief on a page
DARKNESS = 0.7  # darkness (0 to 1) of a place that all outlines of a belief cover
# Metadata that a file leaves out, by suffix: dates and versions, which would differ from run to run.
UNSIGNED = {
    ".png": {"Software": None},
    ".svg": {"Creator": None, "Date": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
}


def style() -> AbstractContextManager[None]:
    """The style of all pictures, as a context for drawing and saving."""
    return mpl_style.context(TEMPLATES / "pictures.mplstyle")


def save(path: Path, draw: Callable[[], Figure]) -> None:
    """Writes the figure that `draw` returns; the suffix of the path states the format.

    The same figure gives the same bytes.
    """
    with style(), writing(path) as file:
        draw().savefig(file, dpi=DPI, metadata=UNSIGNED[path.suffix.lower()])


def blank(width_in: float, height_in: float) -> Figure:
    """Returns a white figure with automatic layout."""
    return Figure(figsize=(width_in, height_in), facecolor="white", layout="constrained")


def panels(figure: Figure, rows: int, columns: int, count: int) -> list[Axes]:
    """The first `count` panels of a grid with common axes, row by row; the rest stays empty."""
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes in grid.flat[count:]:
        axes.remove()
    return list(grid.flat[:count])


def faint_grid(axes: Axes, axis: Literal["both", "x", "y"] = "both") -> None:
    """Draws a grid of pale lines under everything else."""
    axes.grid(axis=axis, color="#ececec", linewidth=0.5)
    axes.set_axisbelow(True)


def caption(figure: Figure, x: str, y: str, size: float) -> None:
    """Labels the common axes of a figure."""
    figure.supxlabel(x, fontsize=size)
    figure.supylabel(y, fontsize=size)


def polygons(
    axes: Axes,
    shapes: Sequence[Array] | Array,
    colour: str,
    width: float,
    order: float = 2.0,
    fill: float = 0.0,
    edge: float = 1.0,
) -> None:
    """Draws closed polygons (n, N, 2) [mm]; the limits of the axes do not change.

    `width` is that of the edges in points; `fill` and `edge` are opacities, from 0 to 1. Polygons of a higher
    `order` cover those of a lower one.
    """
    faces = to_rgba(colour, fill) if fill else "none"
    edges = to_rgba(colour, edge)
    drawn = PolyCollection(
        list(shapes), linewidths=width, zorder=order, facecolors=faces, edgecolors=edges
    )
    axes.add_collection(drawn, autolim=False)


def overlay_opacity(count: int, darkness: float) -> float:
    """The opacity at which `count` outlines, drawn over each other, give a `darkness` from 0 to 1."""
    return float(1.0 - (1.0 - darkness) ** (1.0 / max(count, 1)))


def outlines(outline: Array, poses: Array) -> Array:
    """Places an outline (N, 2) at each of n poses (n, 3) [mm, mm, rad]; returns (n, N, 2) [mm]."""
    return placed(outline, poses.T[:, :, None])


def placed(points: Array, pose: Array) -> Array:
    """Transforms points (..., 2) of a body at a pose (3,) [mm, mm, rad] to the world."""
    unturned = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
    return to_world(unturned, pose)[..., :2]


def finger_boxes(jaws: Jaws, width_mm: float) -> Array:
    """The corners (2, 4, 2) of the upper and the lower finger in the hand frame, closed to a width [mm]."""
    opening, length, thickness, share = jaws
    top = 0.5 * opening - share * (opening - width_mm)
    x = 0.5 * length * np.array([-1.0, 1.0, 1.0, -1.0])
    y = thickness * np.array([0.0, 0.0, 1.0, 1.0])
    return np.stack([np.stack([x, top + y], axis=-1), np.stack([x, top - width_mm - y], axis=-1)])


@cache
def template(name: str) -> Template:
    """Loads a file of `planner/report/templates`."""
    templates = environment("planner.report", markup=True)
    templates.filters |= {
        "mm": lambda um: f"{um / 1e3:.2f}",
        "degrees": lambda urad: f"{np.degrees(urad / 1e6):.1f}",
        "percent": lambda share: f"{100 * share:.2f} %",
        "transform": transform,
        "points": points,
        "part": part,
        "few": lambda poses: subsample(poses, OUTLINES),
        "overlay": lambda count: round(overlay_opacity(count, DARKNESS), 4),
    }
    return templates.get_template(name)


@cache
def asset(name: str) -> str:
    """The text of a stylesheet or script among the templates."""
    return (TEMPLATES / name).read_text("utf-8")


def transform(pose: Array) -> str:
    """A pose (3,) [mm, mm, rad] as an SVG transform; the picture's y axis points up."""
    return f"translate({pose[0]:.2f} {pose[1]:.2f})rotate({np.degrees(pose[2]):.1f})"


def part(state: Array) -> int:
    """Index of a part's hypothesis: the last entry of a state (4,), or 0 for a pose (3,)."""
    return int(state[3]) if len(state) > 3 else 0


def points(shape: Array) -> str:
    """Returns vertices (n, 2) as the `points` of an SVG polygon."""
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in shape)
