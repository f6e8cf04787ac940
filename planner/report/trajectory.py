"""Pictures of squeezes: panels as in the paper's Fig. 3, or a page with a slider."""

from collections.abc import Sequence
from html import escape
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.arrays import Array
from planner.mechanics.clearance import Jaws
from planner.part.outline import reach
from planner.report import canvas
from runtime.pages.frame import page
from runtime.shell.files import write

MOST_PANELS = 12
COLUMNS = 4
COLUMNS_IF_TALL = 6
TALL = 1.4  # height over width above which a panel is tall
BETWEEN = 4  # states of a squeeze drawn between the first contact and the end
MARK_MM = 1.5  # distance between the marks of a trace
WIDTH_IN = 2.1  # width of one panel
APPROACH_FRAMES = 14
CONTACT_FRAMES = 46


class Squeezed(NamedTuple):
    """One squeeze, step by step."""

    states: Array  # (k, 4) x, y, theta, width [mm, mm, rad, mm], k >= 2: the first row open, the last final
    status: str  # a status of the simulator


def along(states: Array, widths_mm: Array) -> Array:
    """Interpolates the recorded states (k, 4) of a squeeze at given widths (n,); returns states (n, 4)."""
    latest = states[::-1]  # of several states with the same width, the last one counts
    rising, rows = np.unique(latest[:, 3], return_index=True)
    columns = [np.interp(widths_mm, rising, latest[rows, j]) for j in range(3)]
    return np.stack([*columns, np.asarray(widths_mm, dtype=np.float64)], axis=-1)


def touch(states: Array) -> float:
    """Width at which the part begins to move; the final width if it never does [mm]."""
    moved = np.any(np.abs(states[:, :3] - states[0, :3]) > 1e-9, axis=1)
    if not moved.any():
        return float(states[-1, 3])
    return float(states[max(int(np.argmax(moved)) - 1, 0), 3])


def trail(centres: Array) -> Array:
    """Points (n, 2) at equal distances along a path (k, 2), both ends included [mm]."""
    passed = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(centres, axis=0).T))])
    marks = np.linspace(0.0, passed[-1], 1 + round(passed[-1] / MARK_MM))
    return np.stack([np.interp(marks, passed, centres[:, j]) for j in range(2)], axis=-1)


def figure(outline: Array, jaws: Jaws, traces: Sequence[Squeezed]) -> Figure:
    """Draws a panel for each of 1 to `MOST_PANELS` squeezes; in an SVG, a panel is a group `squeeze-1`, ...

    `outline` (N, 2) is the part [mm].
    """
    half = extent(outline, jaws, traces)
    columns = min(COLUMNS_IF_TALL if half[1] > TALL * half[0] else COLUMNS, len(traces))
    rows = ceil(len(traces) / columns)
    panel_in = WIDTH_IN * half[1] / half[0] + 0.22
    result = canvas.blank(columns * WIDTH_IN + 0.35, rows * panel_in + 0.3)
    panels = canvas.panels(result, rows, columns, len(traces))
    for k, (axes, trace) in enumerate(zip(panels, traces, strict=True)):
        axes.set_gid(f"squeeze-{k + 1}")
        frame(axes, half)
        _draw(axes, outline, jaws, trace.states)
        title = f"{k + 1}  {trace.status}, {trace.states[-1, 3]:.2f} mm"
        axes.set_title(title, fontsize=8.0, pad=4.0)
    canvas.caption(result, "x / mm, along the fingers", "y / mm, closing", 8.0)
    return result


def extent(outline: Array, jaws: Jaws, traces: Sequence[Squeezed]) -> tuple[float, float]:
    """Half the width and half the height of a box that contains all squeezes, with a margin [mm]."""
    centres = np.concatenate([np.abs(trace.states[:, :2]) for trace in traces])
    x = max(0.5 * jaws.length_mm, float(centres[:, 0].max()) + reach(outline))
    y = max(0.5 * jaws.opening_mm + jaws.thickness_mm, float(centres[:, 1].max()) + reach(outline))
    return x + 3.0, y + 3.0


def frame(axes: Axes, half: tuple[float, float]) -> None:
    """Sets equal axes in mm with a faint grid; `half` holds half the width and half the height."""
    axes.set(xlim=(-half[0], half[0]), ylim=(-half[1], half[1]), aspect="equal")
    axes.set_xticks([-20, 0, 20])
    axes.set_yticks([-40, -20, 0, 20, 40])
    axes.tick_params(labelsize=7.0)
    canvas.faint_grid(axes)


def _draw(axes: Axes, outline: Array, jaws: Jaws, states: Array) -> None:
    begun = touch(states)
    between = along(states, np.linspace(begun, states[-1, 3], BETWEEN + 2)[:-1])
    for rows, color, width, order in (
        (between, canvas.GREY, 0.6, 2.0),
        (states[:1], canvas.BLACK, 0.9, 2.5),
        (states[-1:], canvas.RED, 1.3, 3.0),
    ):
        boxes = [box for state in rows for box in canvas.finger_boxes(jaws, float(state[3]))]
        canvas.polygons(axes, [*boxes, *canvas.outlines(outline, rows[:, :3])], color, width, order)
    marks = trail(states[:, :2])
    axes.plot(*marks.T, "+", color=canvas.BLUE, markersize=4.5, markeredgewidth=0.8, zorder=4)


def timeline(states: Array) -> Array:
    """Interpolates the states (k, 4) of a squeeze to the frames of an animation; returns states (n, 4).

    The jaws approach the part fast, and then close at a constant rate.
    """
    begun, end = touch(states), states[-1, 3]
    approach = np.linspace(states[0, 3], begun, APPROACH_FRAMES, endpoint=False)
    return along(states, np.concatenate([approach, np.linspace(begun, end, CONTACT_FRAMES)]))


def html(outline: Array, jaws: Jaws, traces: Sequence[Squeezed], title: str, path: Path) -> None:
    """Writes a page with all squeezes beside each other and one slider; it needs no network.

    `outline` (N, 2) is the part [mm].
    """
    half_x, half_y = extent(outline, jaws, traces)
    data = {
        "outline": canvas.points(outline),
        "jaws": jaws._asdict(),
        "half": {"x": round(half_x, 2), "y": round(half_y, 2)},
        "squeezes": [
            {"status": trace.status, "states": list(map(_named, timeline(trace.states)))}
            for trace in traces
        ],
    }
    body = canvas.asset("squeezes.html").format(title=escape(title))
    style, script = canvas.asset("squeezes.css"), canvas.asset("squeezes.js")
    write(path, page(title, body, style=style, data=data, script=script))


def _named(state: Array) -> dict[str, float]:
    """A state (4,) as a JSON object."""
    return dict(zip(("x", "y", "turn", "width"), np.round(state, 4).tolist(), strict=True))
