"""Limit surfaces of a job, ellipsoids or convex quartics, and random draws of them for kernels."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from planner.arrays import Array, BoolArray, IntArray
from planner.job.model import Job
from planner.mechanics import limit_surface, quartic, quartic_fit
from planner.mechanics.limit_surface import LimitSurface
from planner.mechanics.quartic import QuarticSurface
from planner.part.outline import radius_of_gyration
from planner.part.pressure import Kind, Support, even, stances, support

Surface: TypeAlias = LimitSurface | QuarticSurface
Fit: TypeAlias = Callable[[Array, Array, float], Surface]

MIDDLE = (
    0.6  # scale of the supported area under a part with a bulge, relative to the part's outline
)
FEET = 8  # number of sets of three feet, drawn from all possible sets


def of_job(job: Job) -> Surface:
    """The nominal limit surface of a job: the surface that it states, else one fitted to its pressure."""
    pressure, outline = job.pressure, job.part.outline_mm
    if (
        pressure.quartic is not None
        and pressure.certificate is not None
        and pressure.rho_mm is not None
    ):
        return QuarticSurface(pressure.quartic, pressure.certificate, pressure.rho_mm)
    if pressure.ellipsoid is not None and pressure.rho_mm is not None:
        return LimitSurface(pressure.ellipsoid, pressure.rho_mm)
    return _fitted(_forms_of(job)[0], support(pressure, outline), radius_of_gyration(outline))


def _fitted(fit: Fit, held: Support, rho_mm: float) -> Surface:
    """Fits a limit surface to the support of a part: the points and weights of its pressure.

    A surface that was fitted before comes from a cache.
    """
    points, weights = held
    return _kept(fit, points.tobytes(), weights.tobytes(), rho_mm)


@lru_cache(maxsize=256)
def _kept(fit: Fit, points: bytes, weights: bytes, rho_mm: float) -> Surface:
    """Fits a limit surface to support points and weights, passed as bytes so that the result can be cached.

    The cache saves time, since all worlds in which a plan is tried need surfaces of the same few pressures.
    """
    return fit(np.frombuffer(points).reshape(-1, 2), np.frombuffer(weights), rho_mm)


def _forms_of(job: Job) -> list[Fit]:
    """Fitting functions for the forms of limit surface that a job allows, the job's own form first."""
    forms: list[Fit] = [limit_surface.fit_ellipsoid, quartic_fit.fit_pressure]
    if job.pressure.limit_surface == "quartic":
        forms.reverse()
    return forms if job.pressure.limit_surface == "any" else forms[:1]


def others_of(job: Job) -> tuple[Surface, ...]:
    """Limit surfaces that a part may have instead of the nominal one, according to [doubt] of the job."""
    rho = radius_of_gyration(job.part.outline_mm)
    return tuple(_fitted(fit, held, rho) for fit, held in latent_surfaces(job))


def shares_of(job: Job) -> Array:
    """Probabilities of the nominal surface and of `others_of`; every kind of pressure is equally likely.

    All sets of three feet together are one kind.
    """
    spread, feet = _other_pressures(job)
    shares = np.ones(1 + len(spread) + len(feet))
    shares[1 + len(spread) :] /= max(len(feet), 1)
    shares = np.tile(shares, (1 + len(latent_surfaces(job))) // len(shares))
    return np.asarray(shares / shares.sum())


def latent_surfaces(job: Job) -> list[tuple[Fit, Support]]:
    """Fitting function and support of each alternative to the nominal limit surface of a job.

    An alternative differs from the nominal surface in its pressure, in its form, or in both. The order is
    that of `others_of`.
    """
    form = job.pressure.limit_surface
    if form is None or (form != "any" and job.doubt.pressure == "stated"):
        return []
    spread, feet = _other_pressures(job)
    pressures = [support(job.pressure, job.part.outline_mm), *spread, *feet]
    return [(fit, held) for fit in _forms_of(job) for held in pressures][1:]


def _other_pressures(job: Job) -> tuple[list[Support], list[Support]]:
    """Supports of a part that a job allows besides the stated one.

    Returns:
        The supports that are spread out (rim, whole area, middle of the area), and sets of three feet. Both
        lists are empty if the job states the pressure as certain.
    """
    pressure, outline, rng = job.pressure, job.part.outline_mm, np.random.default_rng(FEET)
    if job.doubt.pressure == "stated":
        return [], []
    kinds: tuple[Kind, ...] = ("boundary", "uniform")
    spread = [
        support(replace(pressure, kind=kind), outline) for kind in kinds if kind != pressure.kind
    ]
    points, weights = support(replace(pressure, kind="uniform"), outline)
    spread.append((MIDDLE * points, weights))
    return spread, [even(feet) for feet in rng.permutation(stances(outline))[:FEET]]


def nominal(surface: Surface) -> Array:
    """The array by which kernels know a surface, without scatter.

    It is the matrix A (3, 3) of an ellipsoid, or the table (6, 6) of the Hessian of a quartic.
    """
    return surface.A if isinstance(surface, LimitSurface) else surface.hessian_table()


def sample(surface: Surface, dof: int | IntArray, rng: np.random.Generator, n: int) -> Array:
    """Draws n random surfaces about a nominal one: (n, 3, 3) ellipsoids or (n, 6, 6) tables of quartics.

    All are physically consistent (paper IV: a Wishart distribution with `dof` degrees of freedom).
    """
    if isinstance(surface, LimitSurface):
        return limit_surface.wishart(surface.A, dof, rng, n)
    return quartic.sample(surface, dof, rng, n)


def sample_each(
    surfaces: Sequence[Surface], which: IntArray, dof: IntArray, rng: np.random.Generator
) -> tuple[Array, BoolArray | None]:
    """Draws a random limit surface for each of n parts.

    Args:
        surfaces: the nominal surfaces.
        which: (n,) index of the nominal surface of each part.
        dof: (n,) degrees of freedom of the scatter about it.
        rng: source of randomness.

    Returns:
        The surfaces and a mask. If all have one form: (n, 3, 3) ellipsoids or (n, 6, 6) quartics, and None.
        If both forms occur: (n, 6, 6), where an ellipsoid fills the leading (3, 3) block, and a mask (n,) of
        the ellipsoids.
    """
    rows = [
        (number, np.flatnonzero(which == number)) for number in np.unique(which).tolist() or [0]
    ]
    drawn = [sample(surfaces[number], dof[chosen], rng, len(chosen)) for number, chosen in rows]
    if len(rows) == 1:
        return drawn[0], None
    size = max(chosen.shape[1] for chosen in drawn)
    whole, ellipsoid = np.zeros((len(which), size, size)), np.zeros(len(which), np.bool_)
    for (number, chosen), some in zip(rows, drawn, strict=True):
        whole[chosen, : some.shape[1], : some.shape[1]] = some
        ellipsoid[chosen] = isinstance(surfaces[number], LimitSurface)
    return whole, ellipsoid if size > 3 and ellipsoid.any() else None
