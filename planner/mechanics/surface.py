"""Either limit surface, ellipsoid or convex quartic, in the form that the kernels take."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from planner.arrays import Array
from planner.job.model import Job
from planner.mechanics import limit_surface, quartic, quartic_fit
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.quartic import QuarticSurface
from planner.part.outline import radius_of_gyration
from planner.part.pressure import support
from planner.part.quartic_form import FORM, PAIRS, coefficients_of, gram

Surface: TypeAlias = LimitSurface | QuarticSurface


def of_job(job: Job) -> Surface:
    """The nominal limit surface of a job: fitted to its pressure, stated, or identified."""
    pressure, outline = job.pressure, job.part.outline_mm
    if pressure.quartic is not None and pressure.certificate is not None and pressure.rho_mm is not None:
        return QuarticSurface(pressure.quartic, pressure.certificate, pressure.rho_mm)
    if pressure.ellipsoid is not None and pressure.rho_mm is not None:
        return LimitSurface(pressure.ellipsoid, pressure.rho_mm)
    quartic_wanted = pressure.limit_surface == "quartic"
    fit = quartic_fit.fit_pressure if quartic_wanted else limit_surface.fit_ellipsoid
    return fit(*support(pressure, outline), radius_of_gyration(outline))


def nominal(surface: Surface) -> Array:
    """The surface for a kernel: (3, 3) the ellipsoid's A, or (6, 6) the quartic's table of its Hessian."""
    return surface.A if isinstance(surface, LimitSurface) else surface.hessian_table()


def sample(surface: Surface, dof: int, rng: np.random.Generator, n: int) -> Array:
    """Physically consistent random surfaces as `nominal`, n of them (paper IV: Wishart with `dof`)."""
    if isinstance(surface, LimitSurface):
        return limit_surface.wishart(surface.A, dof, rng, n)
    return hessian_tables(coefficients_of(quartic.sample(surface, dof, rng, n)))


def hessian_tables(coefficients: Array) -> Array:
    """`QuarticSurface.hessian_table` for many, (n, 15) to (n, 6, 6): linear in the coefficients."""
    unit = np.stack([(FORM @ gram(row).reshape(81)).reshape(6, 6) for row in np.eye(15)])
    halved = np.where(PAIRS[:, :1] == PAIRS[:, 1:], unit, 0.5 * unit)
    return np.ascontiguousarray(np.tensordot(coefficients, halved, axes=1))
