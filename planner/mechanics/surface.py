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
from planner.part.quartic_form import FORM, PAIRS, gram

Surface: TypeAlias = LimitSurface | QuarticSurface


def of_job(job: Job) -> Surface:
    """The nominal limit surface of a job: fitted to its pressure, stated, or identified."""
    pressure, outline = job.pressure, job.part.outline_mm
    if pressure.quartic is not None and pressure.certificate is not None and pressure.rho_mm is not None:
        return QuarticSurface(pressure.quartic, pressure.certificate, pressure.rho_mm)
    if pressure.limit_surface == "quartic":
        return quartic_fit.fit_pressure(*support(pressure, outline), radius_of_gyration(outline))
    return limit_surface.of_job(job)


def nominal(surface: Surface) -> Array:
    """The surface for a kernel: (3, 3) the ellipsoid's A, or (6, 6) the quartic's table of its Hessian."""
    return surface.A if isinstance(surface, LimitSurface) else surface.hessian_table()


def sample(surface: Surface, dof: int, rng: np.random.Generator, n: int) -> Array:
    """Physically consistent random surfaces for kernels (paper IV: Wishart).

    Args:
        surface: the nominal one.
        dof: degrees of freedom n_df.
        rng: source of randomness.
        n: number of draws.

    Returns:
        (n, 3, 3) matrices of ellipsoids or (n, 6, 6) tables of quartics.
    """
    if isinstance(surface, LimitSurface):
        return limit_surface.sample(surface, dof, rng, n)
    return hessian_tables(quartic.sample(surface, dof, rng, n).coefficients)


def hessian_tables(coefficients: Array) -> Array:
    """`QuarticSurface.hessian_table` for many, (n, 15) to (n, 6, 6): linear in the coefficients."""
    unit = np.stack([(FORM @ gram(row).reshape(81)).reshape(6, 6) for row in np.eye(15)])
    halved = np.where(PAIRS[:, :1] == PAIRS[:, 1:], unit, 0.5 * unit)
    return np.ascontiguousarray(np.tensordot(coefficients, halved, axes=1))
