"""The paper's Figs 1, 3 and 4, drawn from this planner's own squeezes; Figs 2 and 6 are trees of tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from planner.arrays import Array
from planner.belief.observation import encoder_of
from planner.belief.particles import subsample
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.mechanics.simulator import STATUS_NAMES, Simulator
from planner.paper.subspaces import subspaces_of
from planner.report import canvas, trajectory
from planner.report.replay import Replay
from planner.report.tree import in_world
from runtime.table import Table

OUTLINES = 90
"""Most outlines drawn in one panel."""
DARKNESS = 0.75
"""Of the place that all outlines of a panel cover."""
WIDTH_IN = 8.3
"""Of a picture: 800 pixels at a text of 8 to 9 points, what a README shows without shrinking it."""
FONT = 8.5

BUTTERFLY_POSES = (
    ("slipped into free space", (19.3, -15.0, 0.7)),
    ("jammed", (-5.7, 12.1, 0.8)),
    ("grasped with offset", (-13.3, -11.5, 1.5)),
    ("grasped with offset", (-0.7, 3.8, 2.7)),
)
"""The four ends of the paper's Fig. 3, and poses in the hand frame [mm, mm, rad] that lead to them."""
MU = 0.5
STATES = ((canvas.BLACK, "before"), (canvas.GREY, "on the way"), (canvas.RED, "at the end"))

SQUEEZES = 8000
"""Rolled out for the subspaces of Fig. 4."""
SPREAD_MM = 20.0
"""Half the side of the square that their centres start in: enough for some to be missed."""
SEED = 4


class Step(NamedTuple):
    """One squeeze on a path through a table.

    Attributes:
        node: which squeezes.
        branch: that its width chose.
    """

    node: int
    branch: int


def likeliest_path(table: Table, beliefs: Replay, squeezes: int) -> list[Step]:
    """The path of this many squeezes from the root to a leaf that most parts take.

    Raises:
        ValueError: no path is that long.
    """
    found: list[tuple[int, list[Step]]] = []
    waiting: list[tuple[int, list[Step]]] = [(0, [])]
    while waiting:
        index, path = waiting.pop()
        for number, branch in enumerate(table.nodes[index].branches):
            steps = [*path, Step(index, number)]
            if branch.target >= 0:
                waiting.append((branch.target, steps))
            elif len(steps) == squeezes:
                found.append((len(beliefs.visits[index].through(number)), steps))
    if not found:
        raise ValueError(f"no path of {squeezes} squeezes leads to a leaf")
    return max(found)[1]


def sequence(table: Table, job: Job, beliefs: Replay, squeezes: int = 3) -> Figure:
    """Fig. 1: how widths shrink a belief to one pose, and one part that takes this path.

    Args:
        table: any.
        job: the job it was compiled from.
        beliefs: parts sent through the table.
        squeezes: length of the path shown.
    """
    path = likeliest_path(table, beliefs, squeezes)
    outline, jaws = job.part.outline_mm, jaws_of(job.gripper)
    poses = [beliefs.visits[0].before] + [beliefs.visits[s.node].through(s.branch) for s in path]
    track, widths = _track(beliefs, path)
    boxes = [_closed(table, step, jaws) for step in path]
    reach = float(np.max(np.hypot(*outline.T)))
    spread = max(float(np.quantile(np.hypot(*belief[:, :2].T), 0.98)) for belief in poses)
    half = 1.05 * max(spread + reach, *(float(np.abs(box).max()) for box in boxes))
    columns = len(poses)
    result = Figure(
        figsize=(WIDTH_IN, 2 * (WIDTH_IN - 0.95) / columns + 0.86), facecolor="white", layout="constrained"
    )
    grid = result.subplots(2, columns, sharex=True, sharey=True)
    for k, (above, below) in enumerate(grid.T):
        for axes in (above, below):
            _frame(axes, half)
        _density(above, outline, poses[k])
        before = track[max(k - 1, 0)]
        canvas.polygons(below, canvas.outlines(outline, before[None]), canvas.GREY, 0.9)
        if k:
            _fingers(above, boxes[k - 1])
            _fingers(below, _closed(table, path[k - 1], jaws, widths[k - 1]))
            canvas.polygons(below, canvas.outlines(outline, track[k][None]), canvas.BLUE, 1.4, fill=0.25)
        above.set_title(_heading(table, path, k, len(poses[k]) / len(poses[0])), fontsize=FONT, pad=4.0)
    _caption(result, "x / mm", "y / mm")
    grid[0, 0].set_ylabel("what is believed", fontsize=FONT)
    grid[1, 0].set_ylabel("where one part is", fontsize=FONT)
    return result


def _heading(table: Table, path: Sequence[Step], k: int, share: float) -> str:
    """Above a column: the squeeze, what it read, and how many parts come to this."""
    if k == 0:
        return "before\nat any angle, all parts"
    node = table.nodes[path[k - 1].node]
    width = node.branches[path[k - 1].branch].expected_um / 1e3
    angle = np.degrees(node.squeeze.angle_urad / 1e6)
    share_text = f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.1f} %"
    return f"squeeze {k} at {angle:.0f}°\nreads {width:.1f} mm, {share_text} of parts"


def _closed(table: Table, step: Step, jaws: Array, width_mm: float | None = None) -> Array:
    """Both fingers (2, 4, 2) in the world after a step, at a width or at the expected one."""
    node = table.nodes[step.node]
    expected = node.branches[step.branch].expected_um / 1e3
    return in_world(canvas.finger_boxes(jaws, expected if width_mm is None else width_mm), node)


def _track(beliefs: Replay, path: Sequence[Step]) -> tuple[list[Array], list[float]]:
    """One part that took a path: its poses (3,) before the first squeeze and after each, and the widths."""
    part = 0
    poses: list[Array] = []
    widths: list[float] = []
    for step in reversed(path):
        visit = beliefs.visits[step.node]
        part = int(np.flatnonzero(visit.branch == step.branch)[part])
        poses.append(visit.after[part])
        widths.append(float(visit.width_mm[part]))
    return [beliefs.visits[path[0].node].before[part], *reversed(poses)], widths[::-1]


def squeezes(job: Job) -> Figure:
    """Fig. 3: single squeezes of the butterfly, nominal limit surface and friction `MU`."""
    simulator = Simulator.of_job(job, workers=1)
    surface = simulator.nominal(1, MU).surfaces[0]
    traces = []
    for _, pose in BUTTERFLY_POSES:
        states, status = simulator.trace(np.array(pose), surface, MU)
        traces.append(trajectory.Squeezed(states, STATUS_NAMES[status]))
    result = trajectory.figure(job.part.outline_mm, simulator.jaws, traces)
    result.set_size_inches(WIDTH_IN, 2.95)
    for k, (axes, trace, (end, _)) in enumerate(zip(result.axes, traces, BUTTERFLY_POSES, strict=True)):
        axes.set_title(f"({chr(97 + k)}) {end}\nwidth {trace.states[-1, 3]:.1f} mm", fontsize=FONT, pad=4.0)
    signs = [Line2D([], [], color=color, label=name) for color, name in STATES]
    centre = Line2D(
        [], [], color=canvas.BLUE, marker="+", linestyle="none", label="centre of mass, every 1.5 mm"
    )
    result.legend(handles=[*signs, centre], loc="outside upper center", ncols=4, frameon=False, fontsize=FONT)
    return result


def partition(job: Job, names: Sequence[str]) -> Figure:
    """Fig. 4: the subspaces of final poses that widths tell apart, the hand at the origin.

    Args:
        job: has the part and the gripper.
        names: what each subspace is, free space first, then by width.

    Raises:
        ValueError: there are more or fewer subspaces than names.
    """
    simulator = Simulator.of_job(job, workers=1)
    rng = np.random.default_rng(SEED)
    poses = rng.uniform([-SPREAD_MM, -SPREAD_MM, 0.0], [SPREAD_MM, SPREAD_MM, np.pi], (SQUEEZES, 3))
    rolled = simulator.roll_out(poses, simulator.sample(SQUEEZES, rng))
    open_jaws = rolled.width_mm >= float(simulator.jaws[0])  # a finger would have stood on the part
    final, width_mm = rolled.poses[~open_jaws], rolled.width_mm[~open_jaws]
    subspaces = subspaces_of(width_mm, encoder_of(job))
    if len(subspaces) != len(names):
        raise ValueError(f"{len(subspaces)} subspaces, but {len(names)} names for them")
    label = subspaces.label(width_mm)
    columns = len(names)
    result = Figure(
        figsize=(WIDTH_IN, (WIDTH_IN - 0.9) / columns + 0.75), facecolor="white", layout="constrained"
    )
    for k, axes in enumerate(result.subplots(1, columns, sharex=True, sharey=True)):
        _frame(axes, 52.0)
        _density(axes, job.part.outline_mm, final[label == k])
        _fingers(axes, canvas.finger_boxes(simulator.jaws, float(subspaces.mean_mm[k])))
        share = f"{100 * subspaces.size[k] / subspaces.size.sum():.0f} % of squeezes"
        width = f"{subspaces.mean_mm[k]:.1f} mm, " if k else ""
        axes.set_title(f"({chr(97 + k)}) {names[k]}\n{width}{share}", fontsize=FONT, pad=4.0)
    _caption(result, "x / mm, along the fingers", "y / mm, closing")
    return result


def _frame(axes: Axes, half: float) -> None:
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
    axes.set_xticks([-40, -20, 0, 20, 40])
    axes.set_yticks([-40, -20, 0, 20, 40])
    axes.tick_params(labelsize=7.5)


def _caption(figure: Figure, x: str, y: str) -> None:
    figure.supxlabel(x, fontsize=FONT)
    figure.supylabel(y, fontsize=FONT)


def _density(axes: Axes, outline: Array, poses: Array) -> None:
    """A sample of the poses, so transparent that full overlap looks alike in all panels."""
    poses = subsample(poses, OUTLINES)
    fill = 1.0 - (1.0 - DARKNESS) ** (1.0 / max(len(poses), 1))
    shapes = canvas.outlines(outline, poses)
    canvas.polygons(axes, shapes, canvas.BLUE, 0.4, fill=fill, edge=min(0.8, 4.0 * fill))


def _fingers(axes: Axes, boxes: Array) -> None:
    canvas.polygons(axes, boxes, canvas.RED, 1.0, 3.0, fill=0.25)
