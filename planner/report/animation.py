"""Squeezes that move: a GIF of one, or a page with a slider for several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from planner.arrays import Array
from planner.report import canvas
from planner.report.templating import template
from planner.report.trajectory import Squeezed, along, extent, frame, touch
from runtime.shell.files import writing

APPROACH_FRAMES = 14
CONTACT_FRAMES = 46
HOLD_FRAMES = 20
FRAMES_PER_S = 20
GIF_DPI = 100
GIF_WIDTH_IN = 3.4


def timeline(states: Array) -> Array:
    """States (n, 4) to show of a squeeze, one a frame: a quick approach, then the contact, even in width.

    Args:
        states: (k, 4) as in `Squeezed`.
    """
    begun, end = touch(states), states[-1, 3]
    approach = np.linspace(states[0, 3], begun, APPROACH_FRAMES, endpoint=False)
    return along(states, np.concatenate([approach, np.linspace(begun, end, CONTACT_FRAMES)]))


def gif(outline: Array, jaws: Array, trace: Squeezed, path: Path) -> None:
    """Writes one squeeze as an animation that holds its last frame a second and starts again.

    Args:
        outline: (N, 2) the part [mm].
        jaws: (4,) opening, finger length, finger thickness [mm], the upper finger's share of the closing.
        trace: the squeeze.
        path: ends in .gif.
    """
    frames = timeline(trace.states)
    with canvas.style(), writing(path) as file:
        figure, moving = _scene(outline, jaws, trace)
        writer = PillowWriter(fps=FRAMES_PER_S)
        with writer.saving(figure, str(file), GIF_DPI):
            for k in range(len(frames) + HOLD_FRAMES):
                last = min(k, len(frames) - 1)
                moving.show(frames[: last + 1])
                if last == len(frames) - 1:
                    figure.axes[0].set_title(f"{trace.status}, {frames[-1, 3]:.2f} mm")
                writer.grab_frame()


class _Moving:
    """What moves in the scene: fingers, part and the centre's trace."""

    def __init__(self, outline: Array, jaws: Array, figure: Figure) -> None:
        axes = figure.axes[0]
        self.outline, self.jaws = outline, jaws
        red, blue = canvas.RED, canvas.BLUE
        self.fingers = PolyCollection([], facecolors=to_rgba(red, 0.2), edgecolors=red, linewidths=1.0)
        self.part = Polygon(outline, facecolor=to_rgba(blue, 0.2), edgecolor=blue, linewidth=1.2)
        axes.add_collection(self.fingers, autolim=False)
        axes.add_patch(self.part)
        (self.trace,) = axes.plot([], [], color=blue, linewidth=1.0)
        self.title = axes.set_title("0.0 mm")

    def show(self, states: Array) -> None:
        """The last of the states, and the way there."""
        now = states[-1:]
        self.fingers.set_verts(list(canvas.finger_boxes(self.jaws, float(now[0, 3]))))
        self.part.set_xy(canvas.outlines(self.outline, now[:, :3])[0])
        self.trace.set_data(states[:, 0], states[:, 1])
        self.title.set_text(f"{now[0, 3]:.1f} mm")


def _scene(outline: Array, jaws: Array, trace: Squeezed) -> tuple[Figure, _Moving]:
    half = extent(outline, jaws, [trace])
    height = GIF_WIDTH_IN * half[1] / half[0] + 0.1
    figure = Figure(figsize=(GIF_WIDTH_IN, height), facecolor="white", layout="constrained")
    axes = figure.add_subplot()
    frame(axes, half)
    axes.set(xlabel="x / mm, along the fingers", ylabel="y / mm, closing")
    start = canvas.outlines(outline, trace.states[:1, :3])[0]
    axes.add_patch(Polygon(start, fill=False, edgecolor=canvas.GREY, linewidth=0.8))
    moving = _Moving(outline, jaws, figure)
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # or the axes would shift from frame to frame
    return figure, moving


def html(outline: Array, jaws: Array, traces: Sequence[Squeezed], title: str, path: Path) -> None:
    """Writes a page with all squeezes beside each other and one slider; it needs no network.

    Args:
        outline: (N, 2) the part [mm].
        jaws: (4,) as in `gif`.
        traces: the squeezes.
        title: of the page.
        path: ends in .html.
    """
    half = extent(outline, jaws, traces)
    data = {
        "outline": np.round(outline, 3).tolist(),
        "jaws": [float(value) for value in jaws],
        "half": [round(value, 2) for value in half],
        "squeezes": [
            {"status": trace.status, "states": np.round(timeline(trace.states), 4).tolist()}
            for trace in traces
        ],
    }
    page = template("squeezes.html").render(title=title, data=data, colors=vars(canvas))
    with writing(path) as file:
        file.write_text(page, encoding="utf-8")
