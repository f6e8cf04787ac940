"""Pushes by round tips, for `plan-simulate --push --tip-radius-mm`.

A line of the file states the centre of a tip at the start and the whole straight way of the tip, in the frame
of `outline_mm` of the job. Recorded tips often overlap the part at the start, by millimetres. Such a tip
starts at the nearest place outside, where it just touches, and goes the same way: of the corrections tried on
recorded pushes this one agrees best with the measurements (decision 0049).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely

from planner import columns
from planner.arrays import Array, IntArray
from planner.mechanics.push import PUSH_NAMES, Paths
from planner.mechanics.simulator import Pushed
from runtime.shell.errors import InputError

NAMES = ("tip_x_mm", "tip_y_mm", "way_x_mm", "way_y_mm")
MOVED = ("moved_x_mm", "moved_y_mm", "turned_deg")
OVERLAP = "overlap_mm"
STATUS_NAMES = (*PUSH_NAMES, "untouched")
# A part that is only pushed may be wider than the jaws open.
ANY_OPENING = {"gripper": {"opening_mm": 1000.0}}
UNTOUCHED = len(PUSH_NAMES)
MOST_MM = 1e4  # largest magnitude of an entry
CLEAR_MM = 1e-3  # overlap that is tolerated
ROUNDS = 20
ARCS = 256  # Segments of a quarter circle of the outline offset by the radius


class Beside(NamedTuple):
    """Paths of pushes, moved where necessary so that the tips start clear of the part.

    With them, how far the tips overlapped the part where the user said that they start.
    """

    paths: Paths
    overlap_mm: Array  # (n,) overlap of the deepest tip as stated; 0 where clear


def read(path: Path) -> dict[str, Array]:
    """Reads the columns `NAMES` of n pushes.

    Raises:
        InputError: see `columns.read`; or an entry is out of range.
    """
    stated = columns.read(path, NAMES)
    check_range(stated, {}, path)
    return stated


def check_range(stated: Mapping[str, Array], most: Mapping[str, float], where: Path) -> None:
    """Refuses pushes with an entry of too large a magnitude.

    `most` states the largest magnitude by column; for other columns it is `MOST_MM`.

    Raises:
        InputError: an entry is too large; the message names the push and the column.
    """
    for name, values in stated.items():
        bound = most.get(name, MOST_MM)
        far = np.flatnonzero(np.abs(values) > bound)
        if len(far):
            problem = f"push {far[0] + 1}: {values[far[0]]:g} is beyond {bound:g}; correct it"
            raise InputError(problem, where=str(where), key=name)


def paths(stated: Mapping[str, Array], centroid: Array) -> Paths:
    """Converts pushes from `read` to paths in the part's frame, whose origin is at `centroid` (2,) [mm]."""
    centres = np.column_stack([stated["tip_x_mm"], stated["tip_y_mm"]]) - centroid
    ways = np.column_stack([stated["way_x_mm"], stated["way_y_mm"]])
    return Paths(centres[:, None], centres, np.zeros(len(centres)), ways)


def beside(paths: Paths, radius_mm: float, outline: Array, where: Path) -> Beside:
    """Shifts the start of each push so that its round tips no longer overlap the part.

    The shift is the shortest one that clears the deepest tip. While another tip overlaps, this is repeated.

    Raises:
        InputError: a tip overlaps the part by its diameter or more, or no place beside it is free.
    """
    overlap = np.maximum(_depth(paths.points, radius_mm, outline).max(axis=1), 0.0)
    if overlap.max(initial=0.0) >= 2.0 * radius_mm:
        number = int(np.argmax(overlap))
        overlaps = f"the tip overlaps the part by {overlap[number]:.3g} mm at the start"
        problem = f"push {number + 1}: {overlaps}, its diameter or more"
        remedy = "state its centre, in the frame of the job's outline_mm"
        raise InputError(f"{problem}; {remedy}", where=str(where))
    shift, inside = _way_out(paths.points, radius_mm, outline)
    if len(inside):
        problem = "no place beside the part is free for all tips; correct where they start"
        raise InputError(f"push {inside[0] + 1}: {problem}", where=str(where))
    return Beside(_moved(paths, shift), overlap)


def scattered(
    paths: Paths, std_mm: float, radius_mm: float, outline: Array, rng: np.random.Generator
) -> Paths:
    """Shifts each path by normally distributed errors (`std_mm`) of its start in x and y.

    Tips that then overlap the part are moved clear of it; if no place is free, the path starts as stated.
    """
    off = std_mm * rng.standard_normal((len(paths.points), 2))
    shift, inside = _way_out(paths.points + off[:, None], radius_mm, outline)
    shift += off
    shift[inside] = 0.0
    return _moved(paths, shift)


def _way_out(points: Array, radius_mm: float, outline: Array) -> tuple[Array, IntArray]:
    """Finds shifts after which n pushers no longer overlap the part.

    A pusher has K round tips, centred at `points` (n, K, 2). Each round moves a pusher until the tip that was
    deepest in the part is clear.

    Returns:
        Shifts (n, 2), and the indices of pushers that still overlap after `ROUNDS` rounds.
    """
    edge = shapely.Polygon(outline).buffer(radius_mm, quad_segs=ARCS).boundary
    shift, rows = np.zeros((len(points), 2)), np.arange(len(points))
    for round_ in range(ROUNDS + 1):
        tips = points[rows] + shift[rows, None]
        depth = _depth(tips, radius_mm, outline)
        inside = depth.max(axis=1) > CLEAR_MM
        rows, depth, tips = rows[inside], depth[inside], tips[inside]
        if not len(rows) or round_ == ROUNDS:
            break
        deepest = tips[np.arange(len(rows)), depth.argmax(axis=1)]
        along = shapely.line_locate_point(edge, shapely.points(deepest))
        nearest = shapely.line_interpolate_point(edge, along)
        shift[rows] += shapely.get_coordinates(nearest) - deepest
    return shift, rows


def _moved(paths: Paths, shift: Array) -> Paths:
    return paths._replace(points=paths.points + shift[:, None], centres=paths.centres + shift)


def _depth(points: Array, radius_mm: float, outline: Array) -> Array:
    """Overlap (n, K) of round tips at `points` (n, K, 2) with the part; negative where clear [mm]."""
    part, centres = shapely.Polygon(outline), shapely.points(points)
    away = shapely.distance(part.exterior, centres)
    return np.asarray(radius_mm - np.where(shapely.contains(part, centres), -away, away))


def status(pushed: Pushed) -> IntArray:
    """Indices (n,) into `STATUS_NAMES`: the status of each push, or untouched if the part did not move."""
    return np.where(pushed.moved.any(axis=1), pushed.status, UNTOUCHED)
