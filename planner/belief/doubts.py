"""What a job doubts, as traits of particles: drawn once for a part, and kept in all its squeezes."""

import numpy as np

from planner.arrays import Array
from planner.belief.particles import Belief, initial
from planner.job.model import Job
from planner.job.schema import Interval
from planner.mechanics.surface import others_of
from planner.mechanics.traits import FRESH, SHAPES, Traits, as_planned
from planner.part.outline import min_width

SLIPPERY, ROUGH = 1.0 / 3.0, 1.5
"""How far doubted friction lies outside the job's bounds, in units of them."""
WAVY = 0.5  # standard deviation of all the waves of a contour together, in units of the tolerance


def believed(job: Job, n: int, rng: np.random.Generator) -> Belief:
    """Draws n parts as the job believes in them: where they lie, and their traits."""
    return Belief.of(initial(job, n, rng), traits=traits_of(job, n, rng))


def traits_of(job: Job, n: int, rng: np.random.Generator) -> Traits:
    """Draws the traits (n,) of parts: each off by itself, with the job's chance, friction with its own."""
    traits, doubt = as_planned(n), job.doubt
    traits["friction"] = _friction(job, n, rng)
    traits["share"] = _drawn(doubt.finger_share, doubt.chance, n, rng)
    # The hand is calibrated where the fingers meet on the part's narrowest side, but for `middle_mm`.
    traits["across_mm"] = closing_mm(job) * traits["share"] + _drawn(doubt.middle_mm, doubt.chance, n, rng)
    traits["encoder_mm"] = _drawn(doubt.encoder_mm, doubt.chance, n, rng)
    traits["gain"] = _drawn(doubt.encoder_gain, doubt.chance, n, rng)
    traits["surface"] = rng.integers(1, 1 + max(1, len(others_of(job))), n)
    traits["surface"][(rng.random(n) >= doubt.chance) | (doubt.pressure == "stated")] = 0
    if doubt.least_dof:
        low, high = sorted((doubt.least_dof, job.pressure.wishart_dof))
        dof = np.exp(rng.uniform(np.log(low), np.log(high), n)).astype(np.int64)
        traits["dof"] = np.where(rng.random(n) < doubt.chance, dof, 0)
    traits["deviation"] = _deviations(job.part.tolerance_mm, doubt.chance, n, rng)
    return traits


def _friction(job: Job, n: int, rng: np.random.Generator) -> Array:
    """Friction (n,) outside the bounds for a share (`friction.doubt`) of the parts, `FRESH` for the others.

    Half of those lie between `SLIPPERY` times the lower bound and that bound, the others between the upper
    bound and `ROUGH` times that.
    """
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    slippery = rng.uniform(SLIPPERY * low, low, n)
    rough = rng.uniform(high, ROUGH * high, n)
    friction = np.where(rng.random(n) < 0.5, slippery, rough)
    friction[rng.random(n) >= job.friction.doubt] = FRESH
    return friction


def _drawn(interval: Interval, chance: float, n: int, rng: np.random.Generator) -> Array:
    """Values (n,) off with a chance, then by the arcsine law: faults that matter lie near the ends."""
    low, high = interval
    values = 0.5 * (low + high) + 0.5 * (high - low) * np.sin(np.pi * (rng.random(n) - 0.5))
    return np.asarray(np.where(rng.random(n) < chance, values, 0.5 * (low + high)))


def _deviations(tolerance_mm: float, chance: float, n: int, rng: np.random.Generator) -> Array:
    """Deviations of outlines (n, SHAPES) [mm]: offset, scale, and waves along the contour."""
    shapes = np.empty((n, SHAPES))
    for k in range(2):
        shapes[:, k] = _drawn((-tolerance_mm, tolerance_mm), chance, n, rng)
    waves = WAVY * tolerance_mm / np.sqrt(0.5 * (SHAPES - 2))
    shapes[:, 2:] = waves * rng.standard_normal((n, SHAPES - 2))
    shapes[rng.random(n) >= chance, 2:] = 0.0
    return shapes


def stated(job: Job, n: int) -> Traits:
    """The traits (n,) of parts where nothing is off: each doubt in the middle of its interval."""
    traits, doubt = as_planned(n), job.doubt
    traits["share"] = 0.5 * sum(doubt.finger_share)
    traits["across_mm"] = closing_mm(job) * traits["share"] + 0.5 * sum(doubt.middle_mm)
    traits["encoder_mm"] = 0.5 * sum(doubt.encoder_mm)
    traits["gain"] = 0.5 * sum(doubt.encoder_gain)
    return traits


def closing_mm(job: Job) -> float:
    """How far the jaws close on the part's narrowest side."""
    return float(job.gripper.opening_mm - min_width(job.part.outline_mm))
