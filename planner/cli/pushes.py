"""Pushes in CSV files, for `plan-simulate --push`.

A line of the file states one push by two fingers, which stand for the ends of an edge: their middle and
distance, the direction from which they come, and their rotation about a centre. Coordinates are in the frame
in which the job writes `outline_mm`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import shapely
from numpy.random import Generator

from planner import columns
from planner.arrays import Array
from planner.belief.doubts import pushed_of
from planner.cli import tips
from planner.errors import KeyNameError
from planner.job.model import Job
from planner.mechanics.push import Paths
from planner.mechanics.simulator import Pushed, Simulator
from runtime.shell.errors import InputError

PLACES = ("push_x_mm", "push_y_mm", "approach_x", "approach_y", "cor_x_mm", "cor_y_mm", "angle_deg")
FINGERS = "fingers_mm"
SHIFTS = {"shift_x_mm": 0.0, "shift_y_mm": 0.0}
MOST = {"angle_deg": 360.0, FINGERS: 1e3}  # largest magnitudes; other columns: `tips.MOST_MM`
BOUNDS = tuple(f"{name}_{end}" for name in tips.MOVED for end in ("low", "high"))
SHARES = (0.05, 0.95)  # Quantiles of `BOUNDS`
START_MM = 1.1  # scatter of the places where recorded pushers stand beside the part (decision 0049)
AT_ONCE = 100_000  # pushes whose mechanics are drawn together
DEEPEST_MM = 1.0  # Depth at which a finger may start: coordinates on an edge are rounded


class Draws(NamedTuple):
    """How often each push is simulated, and how its start scatters."""

    number: int
    start_mm: float  # standard deviation of x and of y of the place where a pusher starts


class Drawn(NamedTuple):
    """Ranges of the displacements of n pushes; each push was simulated many times, with drawn parameters."""

    bounds: Array  # (n, 6) low and high of x, y [mm] and the angle [degrees]
    given_up: int  # number of pushes cut short, over all draws


def read(path: Path, fingers_mm: float | None) -> dict[str, Array]:
    """Reads the columns `PLACES`, `FINGERS` and `SHIFTS` of n pushes; `SHIFTS` may be missing.

    `fingers_mm` is the distance of the two fingers in a file without the column `FINGERS`.

    Raises:
        InputError: see `columns.read`; or no distance is stated, or an entry is out of range.
    """
    distance = {} if fingers_mm is None else {FINGERS: fingers_mm}
    try:
        stated = columns.read(path, PLACES if distance else (*PLACES, FINGERS), distance | SHIFTS)
    except KeyNameError as error:
        if FINGERS not in error.problem:
            raise
        raise KeyNameError(f"{error.problem}, or give --fingers-mm", where=error.where) from None
    tips.check_range(stated, MOST, path)
    x, y, distance_mm = stated["approach_x"], stated["approach_y"], stated[FINGERS]
    for number in np.flatnonzero(distance_mm < 0.0):
        problem = f"push {number + 1}: {distance_mm[number]:g} is no distance; 0 is a single finger"
        raise InputError(problem, where=str(path), key=FINGERS)
    for number in np.flatnonzero((x == 0.0) & (y == 0.0)):
        problem = f"push {number + 1}: both are 0; state the direction in which the fingers come"
        raise InputError(problem, where=str(path), key="approach_x, approach_y")
    return stated


def paths(stated: Mapping[str, Array], centroid: Array) -> Paths:
    """Converts pushes from `read` to paths in the part's frame, whose origin is at `centroid` (2,) [mm]."""

    def pairs(*names: str) -> Array:
        return np.column_stack([stated[name] for name in names])

    approach = pairs("approach_x", "approach_y")
    approach /= np.hypot(*approach.T)[:, None]
    across = 0.5 * stated[FINGERS][:, None] * np.column_stack([-approach[:, 1], approach[:, 0]])
    middle = pairs("push_x_mm", "push_y_mm") - centroid
    fingers = np.stack([middle - across, middle + across], axis=1)
    centres = pairs("cor_x_mm", "cor_y_mm") - centroid
    return Paths(fingers, centres, np.radians(stated["angle_deg"]), pairs(*SHIFTS))


def check_clear(paths: Paths, outline: Array, where: Path) -> None:
    """Refuses pushes whose fingers start inside the part.

    Raises:
        InputError: a finger starts inside the part; the message names the push and the depth.
    """
    part, fingers = shapely.Polygon(outline), shapely.points(paths.points)  # (n, 2)
    depth = np.where(shapely.contains(part, fingers), shapely.distance(part.exterior, fingers), 0.0)
    if depth.max(initial=0.0) > DEEPEST_MM:
        number, finger = np.unravel_index(int(np.argmax(depth)), depth.shape)
        problem = f"a finger starts {depth[number, finger]:.3g} mm inside the part"
        remedy = "state where the fingers meet it, in the frame of the job's outline_mm"
        raise InputError(f"push {number + 1}: {problem}; {remedy}", where=str(where))


def exact(job: Job) -> Job:
    """Returns a copy of a job in which a quartic limit surface replaces the ellipsoid.

    Only a job with pressure on the rim or over the area has an ellipsoid that can be replaced; any other job
    is returned unchanged. The quartic predicts pushes better than the ellipsoid, but takes ten times as long:
    too long for plans, not for a list of pushes.
    """
    pressure = job.pressure
    spread = pressure.kind in ("boundary", "uniform") and pressure.limit_surface == "ellipsoid"
    return job.replaced(pressure={"limit_surface": "quartic"}) if spread else job


def drawn(
    simulator: Simulator, job: Job, paths: Paths, radius_mm: float, draws: Draws, rng: Generator
) -> Drawn:
    """Simulates each push many times; returns the quantiles `SHARES` of its displacements."""
    n, given_up = len(paths.angles), 0
    bounds, some = np.empty((n, 3, 2)), max(AT_ONCE // draws.number, 1)
    for start in range(0, n, some):
        rows = np.arange(start, min(start + some, n))
        many = Paths(*(np.repeat(values[rows], draws.number, axis=0) for values in paths))
        if draws.start_mm:
            many = tips.scattered(many, draws.start_mm, radius_mm, job.part.outline_mm, rng)
        pushed = draw(simulator, job, many, radius_mm, rng)
        moved = in_degrees(pushed.moved).reshape(len(rows), draws.number, 3)
        bounds[rows] = np.moveaxis(np.quantile(moved, SHARES, axis=1), 0, 2)
        given_up += int(pushed.given_up.sum())
    return Drawn(bounds.reshape(n, 6), given_up)


def draw(simulator: Simulator, job: Job, paths: Paths, radius_mm: float, rng: Generator) -> Pushed:
    """Simulates each of n pushes once, with friction and latent parameters drawn from the job."""
    n = len(paths.angles)
    return simulator.push(paths, simulator.sample(n, rng, pushed_of(job, n, rng)), radius_mm)


def in_degrees(moved: Array) -> Array:
    """Converts displacements (n, 3) [mm, mm, rad] to mm and degrees."""
    return np.column_stack([moved[:, :2], np.degrees(moved[:, 2])])
