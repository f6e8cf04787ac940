"""Charts of results in `tests/bench/results`: the paper's Table I, and recorded pushes."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.report import canvas

WIDTH_IN = 8.3
FONT = 8.5
SMALL = 7.5
ORANGE = "#E69F00"
SKY = "#56B4E9"
GROUPS = {"all": canvas.BLACK, "abs": canvas.BLUE, "plywood": ORANGE}
ENDS = {
    "start": ("at the start", canvas.GREY),
    "measured": ("measured end", canvas.BLUE),
    "predicted": ("predicted end", canvas.RED),
}
METHODS = {
    "closed-loop": ("this planner", canvas.BLUE),
    "fixed-actions": ("this planner, fixed actions", SKY),
    "paper": ("the paper's method, implemented here", ORANGE),
    "sensorless": ("no sensor", canvas.RED),
}


def table_one(rows: Sequence[Mapping[str, Any]], radii_mm: Mapping[str, float]) -> Figure:
    """Charts the share of located parts in each experiment of Table I: the paper's robot, and simulation.

    As in the paper, a simulated part counts as located if the pose that the plan states is within the goal,
    even if the plan reports the pose as uncertain.

    Args:
        rows: results of `comparison.run`.
        radii_mm: for each part, the radius of the disc in which its centre initially lies.

    Raises:
        ValueError: there is no row, or a row lacks the success rate of the paper.
    """
    if not rows or any(row["paper"] is None for row in rows):
        raise ValueError("rows of Table I are needed, each with the paper's rate; run tools/table1")
    experiments = list(dict.fromkeys(row["row"] for row in rows))
    first = {name: next(row for row in rows if row["row"] == name) for name in experiments}
    methods = [name for name in METHODS if any(row["method"] == name for row in rows)]
    judged = {(row["row"], row["method"]): row for row in rows if "within_rate" in row}
    figure = canvas.blank(WIDTH_IN, 3.3)
    axes = figure.subplots()
    width = 0.82 / (1 + len(methods))
    places = np.arange(len(experiments)) - 0.41 + 0.5 * width
    paper = [100.0 * first[name]["paper"] for name in experiments]
    _bars(axes, places, paper, width, canvas.GREY, "the paper's robot")
    for k, method in enumerate(methods):
        shown = [
            (x, judged[n, method])
            for x, n in zip(places, experiments, strict=True)
            if (n, method) in judged
        ]
        at = np.array([x for x, _ in shown]) + (k + 1) * width
        values = [100.0 * row["within_rate"] for _, row in shown]
        label, colour = METHODS[method]
        _bars(axes, at, values, width, colour, f"{label}, in simulation")
        bounds = 100.0 * np.array([row["within_ci95"] for _, row in shown]).reshape(-1, 2)
        style = {"fmt": "none", "ecolor": canvas.BLACK, "elinewidth": 0.8, "capsize": 1.5}
        axes.errorbar(at, values, np.abs(bounds.T - values), **style)
    ticks = [
        f"{name}\n{row['part'].split('-')[0]}\n{radii_mm[row['part']]:g} mm\n{row['materials']}"
        for name, row in first.items()
    ]
    axes.set_xticks(range(len(experiments)), ticks, fontsize=SMALL)
    axes.set_ylabel("parts located to 3 mm / %", fontsize=FONT)
    _open_frame(axes, "x", "y")
    axes.set(ylim=(0, 112), xlim=(-0.55, len(experiments) - 0.45))
    figure.legend(loc="outside upper center", ncols=1 + len(methods), frameon=False, fontsize=FONT)
    return figure


def _bars(
    axes: Axes, at: np.ndarray, values: Sequence[float], width: float, colour: str, label: str
) -> None:
    drawn = axes.bar(at, values, 0.94 * width, color=colour, label=label, zorder=2)
    axes.bar_label(drawn, [label_of(value) for value in values], fontsize=SMALL - 1.0, padding=2.5)


def label_of(percent: float) -> str:
    """Formats a percentage with one decimal; 100 becomes "100", and 99.95 to below 100 becomes "<100"."""
    if percent == 100.0:
        return "100"
    return "<100" if percent >= 99.95 else f"{percent:.1f}"


def _open_frame(axes: Axes, named: Literal["x", "y"], measured: Literal["x", "y"]) -> None:
    """Hides two sides of the frame and the ticks of the axis `named`; draws a grid on the axis `measured`."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis=named, length=0)
    canvas.faint_grid(axes, measured)


def calibration(kept: Mapping[str, Any]) -> Figure:
    """Charts how well the predicted scatter of pushes agrees with recorded pushes.

    For x, y and turn, predicted intervals of various sizes are compared with the records. A point shows the
    share of simulated draws in an interval, and the share of recorded pushes that end in the same interval.
    `kept` is the result of `bench_contact.py`.
    """
    figure = canvas.blank(WIDTH_IN, 3.4)
    panels = canvas.panels(figure, 1, 3, 3)
    nominal = 100.0 * np.array(kept["nominal"])
    for axes, name in zip(panels, ("x", "y", "turn"), strict=True):
        axes.plot([0, 100], [0, 100], color=canvas.GREY, linewidth=0.8, label="as stated")
        for group, colour in GROUPS.items():
            shares = 100.0 * np.array(kept["groups"][group]["calibration"][name])
            axes.plot(nominal, shares, "o-", color=colour, linewidth=1.0, markersize=3, label=group)
        axes.set_title(name, fontsize=FONT)
        axes.set(xlim=(0, 100), ylim=(0, 100), aspect="equal")
        canvas.faint_grid(axes)
    canvas.caption(figure, "draws in the interval / %", "measured in it / %", FONT)
    _legend(figure, panels[0])
    return figure


def worst_pushes(kept: Mapping[str, Any]) -> Figure:
    """Draws the recorded pushes that end farthest from the prediction, from results of `bench_contact.py`."""
    figure = canvas.blank(WIDTH_IN, 4.7)
    panels = canvas.panels(figure, 2, 4, len(kept["worst"]))
    turn = np.linspace(0.0, 2.0 * np.pi, 40)
    disc = kept["radius_mm"] * np.column_stack([np.cos(turn), np.sin(turn)])
    for axes, row in zip(panels, kept["worst"], strict=True):
        for pose, (label, colour) in ENDS.items():
            x, y, degrees = row.get(pose, (0.0, 0.0, 0.0))
            outline = np.array(row["outline_mm"] + row["outline_mm"][:1])
            placed = canvas.placed(outline, np.array([x, y, np.radians(degrees)]))
            axes.plot(*placed.T, color=colour, linewidth=1.2, label=label)
        tip = np.array(row["tip_mm"])
        axes.plot(*tip.T, color=canvas.BLACK, linewidth=0.8, label="way of the tip")
        canvas.polygons(axes, tip[:, None] + disc, canvas.BLACK, 0.8)
        off = f"{row['mm']:.0f} mm, {row['deg']:.0f}° (authors {row['authors_mm']:.0f} mm)"
        axes.set_title(f"{row['shape']}, {row['surface']}\n{off}", fontsize=FONT)
        axes.set_aspect("equal")
        canvas.faint_grid(axes)
    canvas.caption(figure, "x / mm", "y / mm", FONT)
    _legend(figure, panels[0])
    return figure


def _legend(figure: Figure, axes: Axes) -> None:
    """Adds one legend above all panels, with the entries of `axes`."""
    style: dict[str, Any] = {"ncols": 4, "frameon": False, "fontsize": FONT}
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", **style)
