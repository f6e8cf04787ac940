"""Squeezes that move: a GIF of one, or a page with a slider for several."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgba
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
    """States (n, 4) of a squeeze (k, 4), one a frame: a quick approach, then the contact, even in width."""
    begun, end = touch(states), states[-1, 3]
    approach = np.linspace(states[0, 3], begun, APPROACH_FRAMES, endpoint=False)
    return along(states, np.concatenate([approach, np.linspace(begun, end, CONTACT_FRAMES)]))


def gif(outline: Array, jaws: Array, trace: Squeezed, path: Path) -> None:
    """Writes one squeeze of an outline (N, 2) [mm] as an animation that holds its last frame a second.

    `jaws` (4,) are those of `planner.mechanics.clearance.jaws_of`; the path ends in .gif.
    """
    frames, half = timeline(trace.states), extent(outline, jaws, [trace])
    height = GIF_WIDTH_IN * half[1] / half[0] + 0.1
    red, blue = canvas.RED, canvas.BLUE
    with canvas.style(), writing(path) as file:
        figure = canvas.blank(GIF_WIDTH_IN, height)
        axes = figure.add_subplot()
        frame(axes, half)
        axes.set(xlabel="x / mm, along the fingers", ylabel="y / mm, closing")
        start = canvas.outlines(outline, trace.states[:1, :3])[0]
        axes.add_patch(Polygon(start, fill=False, edgecolor=canvas.GREY, linewidth=0.8))
        fingers = PolyCollection([], facecolors=to_rgba(red, 0.2), edgecolors=red, linewidths=1.0)
        axes.add_collection(fingers, autolim=False)
        part = Polygon(outline, facecolor=to_rgba(blue, 0.2), edgecolor=blue, linewidth=1.2)
        axes.add_patch(part)
        (centre,) = axes.plot([], [], color=blue, linewidth=1.0)
        title = axes.set_title("0.0 mm")
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # or the axes would shift from frame to frame
        writer = PillowWriter(fps=FRAMES_PER_S)
        with writer.saving(figure, str(file), GIF_DPI):
            for now in range(len(frames) + HOLD_FRAMES):
                shown = frames[: now + 1]
                fingers.set_verts(list(canvas.finger_boxes(jaws, float(shown[-1, 3]))))
                part.set_xy(canvas.placed(outline, shown[-1, :3]))
                centre.set_data(shown[:, 0], shown[:, 1])
                title.set_text(f"{shown[-1, 3]:.1f} mm")
                if now >= len(frames) - 1:
                    title.set_text(f"{trace.status}, {frames[-1, 3]:.2f} mm")
                writer.grab_frame()


def html(outline: Array, jaws: Array, traces: Sequence[Squeezed], title: str, path: Path) -> None:
    """Writes a page with all squeezes beside each other and one slider; it needs no network.

    Arguments as in `gif`; the path ends in .html.
    """
    data = {
        "outline": np.round(outline, 3).tolist(),
        "jaws": jaws.tolist(),
        "half": [round(value, 2) for value in extent(outline, jaws, traces)],
        "squeezes": [
            {"status": trace.status, "states": np.round(timeline(trace.states), 4).tolist()}
            for trace in traces
        ],
    }
    page = template("squeezes.html").render(title=title, data=data, colors=vars(canvas))
    with writing(path) as file:
        file.write_text(page, encoding="utf-8")
