"""Either limit surface, ellipsoid or convex quartic, in the form that the kernels take."""

from dataclasses import replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from planner.arrays import Array, IntArray
from planner.job.model import Job
from planner.mechanics import limit_surface, quartic, quartic_fit
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.quartic import QuarticSurface
from planner.part.outline import convex_hull, radius_of_gyration
from planner.part.pressure import Kind, Pressure, Support, even, support
from planner.part.quartic_form import FORM, PAIRS, coefficients_of, gram

Surface: TypeAlias = LimitSurface | QuarticSurface

FEET = 8  # how many sets of three feet, at corners of the hull, stand for all that a part may stand on


def of_job(job: Job) -> Surface:
    """The nominal limit surface of a job: fitted to its pressure, stated, or identified."""
    pressure, outline = job.pressure, job.part.outline_mm
    if pressure.quartic is not None and pressure.certificate is not None and pressure.rho_mm is not None:
        return QuarticSurface(pressure.quartic, pressure.certificate, pressure.rho_mm)
    if pressure.ellipsoid is not None and pressure.rho_mm is not None:
        return LimitSurface(pressure.ellipsoid, pressure.rho_mm)
    return _fit(pressure, support(pressure, outline), radius_of_gyration(outline))


def _fit(pressure: Pressure, held: Support, rho_mm: float) -> Surface:
    """The surface under a part that is held so, of the form that the job wants."""
    points, weights = held
    return _fitted(pressure.limit_surface == "quartic", points.tobytes(), weights.tobytes(), rho_mm)


@lru_cache(maxsize=256)
def _fitted(quartic_wanted: bool, points: bytes, weights: bytes, rho_mm: float) -> Surface:
    """Kept, since all the worlds that a plan is tried in fit the same few pressures again."""
    fit = quartic_fit.fit_pressure if quartic_wanted else limit_surface.fit_ellipsoid
    return fit(np.frombuffer(points).reshape(-1, 2), np.frombuffer(weights), rho_mm)


def others_of(job: Job) -> tuple[Surface, ...]:
    """The limit surfaces of the pressures that a part may press with instead, as the job doubts."""
    pressure, outline, rng = job.pressure, job.part.outline_mm, np.random.default_rng(FEET)
    if job.doubt.pressure == "stated" or pressure.limit_surface is None:
        return ()
    corners = convex_hull(outline)
    feet = [even(corners[rng.choice(len(corners), 3, replace=False)]) for _ in range(FEET)]
    kinds: tuple[Kind, ...] = ("boundary", "uniform")
    spread = [support(replace(pressure, kind=kind), outline) for kind in kinds if kind != pressure.kind]
    return tuple(_fit(pressure, held, radius_of_gyration(outline)) for held in (*spread, *feet))


def nominal(surface: Surface) -> Array:
    """The surface for a kernel: (3, 3) the ellipsoid's A, or (6, 6) the quartic's table of its Hessian."""
    return surface.A if isinstance(surface, LimitSurface) else surface.hessian_table()


def sample(surface: Surface, dof: int | IntArray, rng: np.random.Generator, n: int) -> Array:
    """Physically consistent random surfaces as `nominal`, n of them (paper IV: Wishart with `dof`)."""
    if isinstance(surface, LimitSurface):
        return limit_surface.wishart(surface.A, dof, rng, n)
    return hessian_tables(coefficients_of(quartic.sample(surface, dof, rng, n)))


def hessian_tables(coefficients: Array) -> Array:
    """`QuarticSurface.hessian_table` for many, (n, 15) to (n, 6, 6): linear in the coefficients."""
    unit = np.stack([(FORM @ gram(row).reshape(81)).reshape(6, 6) for row in np.eye(15)])
    halved = np.where(PAIRS[:, :1] == PAIRS[:, 1:], unit, 0.5 * unit)
    return np.ascontiguousarray(np.tensordot(coefficients, halved, axes=1))
