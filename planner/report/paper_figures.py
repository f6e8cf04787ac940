"""The paper's Figs 1 and 4, drawn from this planner's own squeezes; Figs 2 and 6 are trees of tables."""

from collections.abc import Collection, Sequence
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.arrays import Array, IntArray
from planner.belief.particles import subsample
from planner.job.model import Job
from planner.mechanics.clearance import Jaws
from planner.paper.subspaces import Subspaces
from planner.part.outline import reach
from planner.report import canvas
from planner.report.look import scenes
from planner.report.replay import Replay
from runtime.table import Table

OUTLINES = 90  # most outlines drawn in one panel
DARKNESS = 0.75  # darkness (0 to 1) of a place that all outlines of a panel cover
WIDTH_IN = 8.3  # 800 pixels at a text of 8 to 9 points: fits a README without scaling
FONT = 8.5

COLUMNS = 4  # most panels beside each other


def sequence(
    table: Table,
    job: Job,
    beliefs: Replay,
    squeezes: Collection[int] = (3,),
    holes: Sequence[Array] = (),
) -> Figure:
    """Draws Fig. 1: the belief before and after each squeeze of a path, and one part on this path.

    `squeezes` are the allowed numbers of squeezes on the path. The part is drawn with its holes (n, 2) [mm]
    in the outline's frame.
    """
    outline, moments = job.part.outline_mm, scenes(table, job, beliefs, squeezes)
    spread = max(float(np.quantile(np.hypot(*each.belief[:, :2].T), 0.98)) for each in moments)
    far = spread + reach(outline)
    half = 1.05 * max(far, *(float(np.abs(each.closed).max()) for each in moments[1:]))
    turn = job.uncertainty.orientation_halfwidth_deg
    angle = "at any angle" if turn >= 180.0 else f"within {turn:g} degrees"
    columns = len(moments)
    result = canvas.blank(WIDTH_IN, 2 * (WIDTH_IN - 0.95) / columns + 0.86)
    grid = result.subplots(2, columns, sharex=True, sharey=True)
    for k, ((above, below), moment) in enumerate(zip(grid.T, moments, strict=True)):
        for axes in (above, below):
            _frame(axes, half)
        _density(above, outline, moment.belief)
        canvas.polygons(below, _outlines(outline, moment.before), canvas.GREY, 0.9)
        title = f"before\n{angle}, all parts"
        if k:
            _fingers(above, moment.closed)
            _fingers(below, moment.holding)
            canvas.polygons(below, _outlines(outline, moment.after), canvas.BLUE, 1.4, fill=0.25)
            for hole in holes:
                canvas.polygons(below, _outlines(hole, moment.after), canvas.BLUE, 0.8)
            percent = 100 * moment.share
            share = f"{percent:.{0 if percent >= 10 else 1}f} % of parts"
            reads = f"reads {moment.width_mm:.1f} mm, {share}"
            title = f"squeeze {k} at {moment.angle_deg:.0f}°\n{reads}"
        above.set_title(title, fontsize=FONT, pad=4.0)
    canvas.caption(result, "x / mm", "y / mm", FONT)
    grid[0, 0].set_ylabel("what is believed", fontsize=FONT)
    grid[1, 0].set_ylabel("where one part is", fontsize=FONT)
    return result


def subspaces(
    solved: Subspaces,
    label: IntArray,
    final: Array,
    outline: Array,
    jaws: Jaws,
    titles: Sequence[str],
) -> Figure:
    """Draws Fig. 4: a panel with a title for each subspace of widths; in an SVG, a panel is a group.

    A panel shows the outline (N, 2) between the jaws at the final poses of one subspace. `final` (n, 3) are
    the poses of all subspaces in the hand frame [mm, mm, rad]; `label` (n,) are their subspaces' numbers.
    """
    columns = min(COLUMNS, len(solved))
    rows = ceil(len(solved) / columns)
    opening, length, thickness, _ = jaws
    half = max(0.5 * opening + thickness, 0.5 * length + 2.0 * reach(outline))
    width_in = WIDTH_IN * columns / COLUMNS
    result = canvas.blank(width_in, rows * ((width_in - 0.9) / columns + 0.35) + 0.4)
    panels = canvas.panels(result, rows, columns, len(solved))
    for k, (axes, title) in enumerate(zip(panels, titles, strict=True)):
        axes.set_gid(f"subspace-{k}")
        _frame(axes, half)
        _density(axes, outline, final[label == k])
        _fingers(axes, canvas.finger_boxes(jaws, float(solved.mean_mm[k])))
        axes.set_title(f"({chr(97 + k)}) {title}", fontsize=FONT, pad=4.0)
    canvas.caption(result, "x / mm, along the fingers", "y / mm, closing", FONT)
    return result


def _outlines(outline: Array, state: Array) -> Array:
    return canvas.outlines(outline, state[None, :3])


def _frame(axes: Axes, half: float) -> None:
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    ticks = [-40, -20, 0, 20, 40]
    axes.set(xticks=ticks, yticks=ticks)
    axes.tick_params(labelsize=7.5)


def _density(axes: Axes, outline: Array, poses: Array) -> None:
    """Draws the outline at a sample of the poses.

    The opacity depends on the size of the sample, so that places which all outlines cover are equally dark
    in all panels.
    """
    poses = subsample(poses, OUTLINES)
    fill = canvas.overlay_opacity(len(poses), DARKNESS)
    shapes = canvas.outlines(outline, poses[:, :3])
    canvas.polygons(axes, shapes, canvas.BLUE, 0.4, fill=fill, edge=min(0.8, 4.0 * fill))


def _fingers(axes: Axes, boxes: Array) -> None:
    canvas.polygons(axes, boxes, canvas.RED, 1.0, 3.0, fill=0.25)
