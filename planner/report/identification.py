"""Picture of an identification: the limit surface with its data, and predicted against measured twists."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from planner.arrays import Array
from planner.identification.identify import Identified, Normalised, Surface, angles
from planner.mechanics.limit_surface import LimitSurface
from planner.report import canvas

COLOURS = {"ellipsoid": canvas.BLUE, "quartic": canvas.RED}
MARKS = {"ellipsoid": "o", "quartic": "^"}
AXES = ("fx / μN", "fy / μN", "τ / (ρ μN)")  # noqa: RUF001
SECTIONS = ((0, 1), (0, 2), (1, 2))  # axes of each cross-section; the third is zero there

# Distance from a section's plane, as a share of the length, below which wrenches are dark.
NEAR = 0.35
SIZE_IN = (7.4, 5.0)


def figure(data: Normalised, fits: Sequence[Identified], title: str) -> Figure:
    """Draws measured pairs of wrench and twist, and for each fit its limit surface and its errors."""
    result = canvas.blank(*SIZE_IN)
    grid = result.subplots(2, 3)
    for axes, plane in zip(grid[0], SECTIONS, strict=True):
        _section(axes, data, fits, plane)
    _twists(grid[1, 0], "turn in the twist / deg", 90.0, turn, data.V, fits)
    _twists(grid[1, 1], "heading of the twist / deg", 180.0, heading, data.V, fits)
    _errors(grid[1, 2], data, fits)
    result.suptitle(title, fontsize=9.0)
    return result


def turn(V: Array) -> Array:
    """Arcsine of the rotation in unit twists (K, 3): 0 for translation, 90 for rotation to the left [deg]."""
    return np.asarray(np.degrees(np.arcsin(np.clip(V[:, 2], -1.0, 1.0))))


def heading(V: Array) -> Array:
    """Direction of the translation in twists (K, 3), in the part's frame [deg]."""
    return np.asarray(np.degrees(np.arctan2(V[:, 1], V[:, 0])))


def section(surface: Surface, plane: tuple[int, int]) -> Array:
    """The closed curve (k, 2) in which a plane of two wrench axes cuts a limit surface."""
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    directions = np.zeros((len(angle), 3))
    directions[:, plane[0]], directions[:, plane[1]] = np.cos(angle), np.sin(angle)
    if isinstance(surface, LimitSurface):
        reach = np.einsum("ki,ij,kj->k", directions, surface.A, directions) ** -0.5
    else:
        reach = surface.value(directions) ** -0.25
    return np.asarray(directions[:, list(plane)] * reach[:, None])


def _section(
    axes: Axes, data: Normalised, fits: Sequence[Identified], plane: tuple[int, int]
) -> None:
    scale = fits[0].fit.friction_n or 1.0  # Directions lie on the unit sphere
    F = data.F / scale
    out = np.delete(F, plane, axis=1)[:, 0]
    near = np.abs(out) < NEAR * np.linalg.norm(F, axis=1)
    for rows, colour, size in ((~near, canvas.PALE, 5.0), (near, canvas.BLACK, 8.0)):
        x, y = F[rows][:, plane].T
        axes.scatter(x, y, s=size, color=colour, linewidths=0.0, zorder=1)
    for result in fits:
        curve = section(result.fit.surface, plane) * (result.fit.friction_n or 1.0) / scale
        axes.plot(*curve.T, color=COLOURS[result.kind], linewidth=1.2, zorder=2)
    cut = f"cut at {AXES[3 - sum(plane)].split(' ')[0]} = 0"
    axes.set(xlabel=AXES[plane[0]], ylabel=AXES[plane[1]], title=cut)
    axes.title.set_fontsize(8.0)
    axes.set_aspect("equal", adjustable="datalim")
    canvas.faint_grid(axes)


def _twists(
    axes: Axes,
    what: str,
    limit: float,
    angle: Callable[[Array], Array],
    V: Array,
    fits: Sequence[Identified],
) -> None:
    axes.plot([-limit, limit], [-limit, limit], color=canvas.GREY, linewidth=0.6, zorder=0)
    for result in fits:
        mark: dict[str, Any] = {"marker": MARKS[result.kind], "edgecolors": COLOURS[result.kind]}
        measured, held_out = angle(V), angle(result.held_out)
        axes.scatter(measured, held_out, s=9.0, facecolors="none", linewidths=0.7, **mark)
    ticks = np.linspace(-limit, limit, 5)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xticks=ticks, yticks=ticks, aspect="equal")
    axes.set(xlabel=f"measured {what}", ylabel="predicted, held out")


def _errors(axes: Axes, data: Normalised, fits: Sequence[Identified]) -> None:
    for result in fits:
        seen = np.isfinite(result.held_out[:, 0])
        error = np.sort(np.degrees(angles(result.held_out[seen], data.V[seen])))
        mean = np.degrees(result.errors_rad.mean())
        colour, label = COLOURS[result.kind], f"{result.kind}: mean {mean:.1f} deg"
        x, shares = np.append(0.0, error), np.linspace(0.0, 1.0, len(error) + 1)
        axes.step(x, shares, where="post", linewidth=1.2, color=colour, label=label)
    axes.set(xlabel="error of the held-out twist / deg", ylabel="share of the pushes")
    axes.set_ylim(0.0, 1.0)
    axes.set_xlim(left=0.0)
    axes.grid(color="#ececec", linewidth=0.5)
    axes.legend(frameon=False, fontsize=7.0, loc="lower right")
