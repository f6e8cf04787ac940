"""Pictures of an episode of `planner.gym`, as pixels: belief, part and last action."""

import math
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from planner.arrays import Array
from planner.part.outline import reach
from planner.pomdp import Pomdp, declares
from planner.report import canvas

SIDE_PX, DPI = 480, 100
MOST_OUTLINES = 150  # most outlines that are drawn of a belief
MARGIN_MM = 3.0


def pixels(model: Pomdp, state: Array, belief: Array, action: Array | None) -> NDArray[np.uint8]:
    """Draws one moment of an episode.

    Args:
        model: the problem.
        state: the state (4,) of the part, drawn as a filled outline.
        belief: states (n, 4) that the readings so far allow, in blue, the darker the likelier.
        action: the last action (4,), in red: fingers that have closed, or the pose that was declared;
            None: the jaws are open at the origin.

    Returns:
        The picture (`SIDE_PX`, `SIDE_PX`, 3), RGB.
    """
    outline, jaws = model.simulator.outline, model.simulator.jaws
    span = model.job.uncertainty.radius_mm + reach(outline)
    corner = math.hypot(0.5 * jaws.opening_mm + jaws.thickness_mm, 0.5 * jaws.length_mm)
    half = max(span, corner) + MARGIN_MM
    if action is None:
        action = np.zeros(4)
    with canvas.style():
        figure = Figure(figsize=(SIDE_PX / DPI, SIDE_PX / DPI), dpi=DPI, facecolor="white")
        axes = figure.add_axes((0.09, 0.07, 0.89, 0.89))
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        canvas.faint_grid(axes)
        likely = canvas.outlines(outline, belief[:MOST_OUTLINES, :3])
        opacity = canvas.overlay_opacity(len(likely), 0.98)
        canvas.polygons(axes, likely, canvas.BLUE, 1.0, edge=max(opacity, 0.04))
        part = canvas.outlines(outline, state[None, :3])
        canvas.polygons(axes, part, canvas.BLACK, 1.2, order=3.0, fill=0.15)
        if declares(action):
            canvas.polygons(axes, canvas.outlines(outline, action[None, :3]), canvas.RED, 1.6, 4.0)
            axes.set_title("declared", fontsize=8.0, pad=4.0)
        else:
            fingers = canvas.finger_boxes(jaws, float(state[3]))
            shown = canvas.placed(fingers, action[:3])
            canvas.polygons(axes, shown, canvas.RED, 1.2, order=4.0, fill=0.2)
            axes.set_title(f"jaws at {state[3]:.1f} mm", fontsize=8.0, pad=4.0)
        drawn: Any = FigureCanvasAgg(figure)  # its methods are not annotated
        drawn.draw()
    return np.asarray(drawn.buffer_rgba())[..., :3].copy()
