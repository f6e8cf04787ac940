"""Simulated cells for a refit: the ranges of their constant errors, and trials in them."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.random import Generator

from planner.arrays import Array
from planner.belief.doubts import ROUGH, SLIPPERY, closing_mm, traits_of
from planner.evaluation.disturbance import Disturbance
from planner.evaluation.outcome import Evaluation
from planner.evaluation.trials import Cell, Program
from planner.job.model import Job
from planner.job.schema import MOST_FRICTION
from planner.mechanics import surface as limit_surface
from planner.mechanics.simulator import Simulator
from planner.mechanics.surface import Surface
from planner.mechanics.traits import Traits, as_planned
from planner.part.pressure import stances
from planner.world import ContactWorld
from runtime.table import Table

LEAST_FRICTION = 0.05
UNEVEN = 0.1  # least half-width of the range of the fingers' share
OFFSET_MM = 1.5  # least half-width of the range of the constant error of widths
FEET = 20  # sets of three feet, besides the limit surfaces of `doubt.pressure = "any"`
INMOST = 0.4  # least distance of such a foot from the centre, as a share of its corner's distance


class Quantity(NamedTuple):
    """An uncertain quantity of a cell with the interval of its values.

    The values of `least_dof` are natural logarithms of the degrees of freedom.
    """

    key: str  # name of the quantity in [doubt] or [friction]
    low: float
    high: float
    stated: float  # the job's value: the middle of its interval, a bound of the friction, or `wishart_dof`


class Space(NamedTuple):
    """The uncertain quantities of a cell, and the number of limit surfaces that its parts may have."""

    quantities: tuple[Quantity, ...]
    surfaces: int

    @classmethod
    def of(cls, job: Job, surfaces: int) -> Self:
        """Returns the space of a job's cells: the intervals of their constant errors and friction.

        The job's intervals are widened to the errors and the friction that are usual in cells. A
        quantity whose interval has no width is left out.
        """
        doubt, friction = job.doubt, job.friction
        usual = {
            "finger_share": UNEVEN,
            "middle_mm": UNEVEN * closing_mm(job),
            "encoder_mm": OFFSET_MM,
            "encoder_gain": 0.0,
        }
        results = []
        for key, most in usual.items():
            low, high = getattr(doubt, key)
            results.append(Quantity(key, min(low, -most), max(high, most), 0.5 * (low + high)))
        if doubt.least_dof and doubt.least_dof != job.pressure.wishart_dof:
            stated = float(np.log(job.pressure.wishart_dof))
            low, high = sorted((float(np.log(doubt.least_dof)), stated))
            results.append(Quantity("least_dof", low, high, stated))
        lowest = friction.finger_part_min
        least = max(min(LEAST_FRICTION, lowest), SLIPPERY * lowest)
        most = min(ROUGH * friction.finger_part_max, MOST_FRICTION)
        for key in ("finger_part_min", "finger_part_max"):
            results.append(Quantity(key, least, most, getattr(friction, key)))
        wide = [quantity for quantity in results if quantity.high > quantity.low]
        return cls(tuple(wide), surfaces)

    @property
    def bounds(self) -> Array:
        """Lower and upper ends of the intervals (2, d)."""
        return np.array([[q.low for q in self.quantities], [q.high for q in self.quantities]])

    def column(self, key: str) -> int:
        """The index of the column that holds the quantity `key` in arrays of points."""
        return [quantity.key for quantity in self.quantities].index(key)

    def draw(self, n: int, rng: Generator) -> Array:
        """Draws points (n, d + 1) from the prior; the last column is the number of the limit surface.

        Each quantity is uniform in its interval; the two bounds of the friction are then sorted. If there are
        several surfaces, about half of the points have surface 0, the surface of the job.
        """
        low, high = self.bounds
        points = rng.uniform(low, high, (n, len(low)))
        bounds = [self.column("finger_part_min"), self.column("finger_part_max")]
        points[:, bounds] = np.sort(points[:, bounds], axis=1)
        surface = np.where(rng.random(n) < 0.5, 0, rng.integers(1, max(2, self.surfaces), n))
        return np.column_stack([points, surface if self.surfaces > 1 else np.zeros(n)])

    def density(self, points: Array) -> Array:
        """The density (n,) of the prior at points (n, d + 1), up to a constant factor."""
        low, high = self.bounds
        inside = ((points[:, :-1] >= low) & (points[:, :-1] <= high)).all(axis=1)
        least, most = (self.column(f"finger_part_{end}") for end in ("min", "max"))
        inside &= points[:, least] <= points[:, most]
        share = np.where(points[:, -1] == 0, 0.5, 0.5 / max(1, self.surfaces - 1))
        return np.where(inside, share, 0.0)


def _on_feet(job: Job) -> list[Surface]:
    """Limit surfaces of parts on three feet, each at a random place between the centre and a corner."""
    corners, rng = stances(job.part.outline_mm), np.random.default_rng(FEET)
    feet = rng.choice(corners, FEET) * rng.uniform(INMOST, 1.0, (FEET, 3, 1))
    pressures = ({"kind": "points", "points_mm": np.round(places, 6).tolist()} for places in feet)
    return [limit_surface.of_job(job.replaced(pressure=pressure)) for pressure in pressures]


@dataclass(frozen=True, slots=True)
class Off(Disturbance):
    """A disturbance that gives all parts the same latent parameters, except for errors of their outlines."""

    all_alike: Traits | None = None  # (1,) latent parameters of all parts; None: as planned

    def traits(self, job: Job, n: int, rng: Generator, contact: bool = True) -> Traits:  # noqa: ARG002
        """The latent parameters (n,) of n parts: equal ones, with an outline error drawn for each part."""
        traits = np.repeat(as_planned(1) if self.all_alike is None else self.all_alike, n)
        if job.part.tolerance_mm:
            traits["deviation"] = traits_of(job, n, rng)["deviation"]
        return traits


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Simulated cells that run a table of one job; a point (d + 1,) states the latent parameters of a cell.

    The first d entries of a point are the quantities of `space`; the last is the index of the limit surface.
    """

    job: Job
    program: Program
    simulator: Simulator
    space: Space

    @classmethod
    def of(cls, job: Job, table: Table) -> Self:
        """Returns cells in which a decision table of a job runs.

        The parts of a cell have the job's limit surface, or another one that `doubt.pressure = "any"` allows.
        If that allows any other, some cells have parts on three feet at random places.
        """
        one_form = {"limit_surface": "ellipsoid"} if job.pressure.limit_surface == "any" else {}
        any_pressure = job.replaced(doubt={"pressure": "any"}, pressure=one_form)
        simulator = Simulator.of_job(any_pressure, workers=1)
        if simulator.others:
            simulator = replace(simulator, others=(*simulator.others, *_on_feet(job)))
        return cls(job, Program.of(table), simulator, Space.of(job, 1 + len(simulator.others)))

    def run(self, point: Array, parts: int, seed: int) -> Evaluation:
        """Runs `parts` parts through the table in the cell that a point (d + 1,) states."""
        values = {quantity.key: point[k] for k, quantity in enumerate(self.space.quantities)}
        friction = values["finger_part_min"], values["finger_part_max"]
        simulator = replace(self.simulator, friction=friction)
        world = ContactWorld.of_simulator(simulator, [seed])
        rng = np.random.default_rng([seed, 0x524546])
        off = Off(all_alike=self._traits(values, int(point[-1])))
        return Cell(self.program, self.job, world, off, rng).run(parts)

    def surface_entries(self) -> Array:
        """The flattened matrices (surfaces, k) of the nominal limit surfaces, the job's first."""
        surfaces = (self.simulator.surface, *self.simulator.others)
        return np.array([limit_surface.nominal(surface).ravel() for surface in surfaces])

    def _traits(self, values: dict[str, Any], surface: int) -> Traits:
        traits = as_planned(1)
        traits["share"] = values.get("finger_share", 0.0)
        traits["across_mm"] = closing_mm(self.job) * traits["share"] + values.get("middle_mm", 0.0)
        traits["encoder_mm"] = values.get("encoder_mm", 0.0)
        traits["gain"] = values.get("encoder_gain", 0.0)
        traits["dof"] = int(np.exp(values["least_dof"])) if "least_dof" in values else 0
        traits["surface"] = surface
        return traits
