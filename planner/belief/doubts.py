"""Draws latent parameters ("traits") of parts from a job's doubts: possible deviations from the plan.

They are drawn once for each part and stay the same in all its squeezes.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.random import Generator

from planner.arrays import Array, IntArray
from planner.belief.particles import Belief, initial
from planner.job.model import Job
from planner.job.schema import Interval
from planner.mechanics.surface import latent_surfaces, shares_of
from planner.mechanics.traits import FRESH, SHAPES, Traits, as_planned, by_hypothesis
from planner.part.outline import min_width

SLIPPERY, ROUGH = 1.0 / 3.0, 1.5
"""Least and greatest doubted friction, as factors of the job's lower and upper bound."""
WAVY = 0.5  # standard deviation of a contour's waves, all together, in units of the tolerance


Draw = Callable[[Job, int, Generator], Array]


def believed(job: Job, n: int, rng: Generator, draw: Draw = initial) -> Belief:
    """Draws n parts from the job's belief: their poses by `draw`, and their traits."""
    return Belief.of(draw(job, n, rng), traits=traits_of(job, n, rng))


def traits_of(job: Job, n: int, rng: Generator, *, with_doubts: bool = True) -> Traits:
    """Draws the traits (n,) of parts; with probability `doubt.chance` one random trait is not as planned.

    Friction is drawn separately: it is outside its bounds for a share of the parts (`friction.doubt`). If
    `with_doubts` is false, parts are as planned, and only their hypotheses are drawn.
    """
    traits = hypotheses_of(job, n, rng)
    for k, rows in by_hypothesis(traits):
        alone, size = job.alone[k], len(traits[rows])
        traits[rows] = _with_doubts(alone, size, rng) if with_doubts else stated(alone, size)
        traits["hypothesis"][rows] = k
    return traits


def pushed_of(job: Job, n: int, rng: Generator) -> Traits:
    """Draws the traits (n,) of parts about which nothing was measured, for pushes along given paths.

    The pressure distribution and the friction of the pusher are drawn independently. The limit surface
    scatters as much as the job's doubt allows. The latent parameters of jaws and encoder keep their planned
    values.
    """
    traits, shares = as_planned(n), shares_of(job)
    traits["surface"] = rng.choice(len(shares), n, p=shares)
    traits["dof"] = job.doubt.least_dof
    traits["friction"] = _friction(job, n, rng)
    return traits


def hypotheses_of(job: Job, n: int, rng: Generator) -> Traits:
    """Returns nominal latent parameters (n,) of parts; the hypothesis of each is drawn by its share."""
    traits = as_planned(n)
    if job.hypothesis:
        traits["hypothesis"] = rng.choice(len(job.shares), n, p=job.shares)
    return traits


def _with_doubts(job: Job, n: int, rng: Generator) -> Traits:
    traits, draws = _middles(job, n), _draws(job, rng)
    fault = np.where(rng.random(n) < job.doubt.chance, rng.integers(0, max(1, len(draws)), n), -1)
    for number, (name, draw) in enumerate(draws):
        rows = np.flatnonzero(fault == number)
        traits[name][rows] = draw(len(rows))
    # The calibrated middle of the hand is where its fingers meet on the narrowest side, up to `middle_mm`.
    traits["across_mm"] += closing_mm(job) * traits["share"]
    traits["friction"] = _friction(job, n, rng)
    return traits


def _intervals(job: Job) -> dict[str, Interval]:
    """The job's doubts that are intervals, by the name of the trait that each one bounds."""
    doubt = job.doubt
    return {
        "share": doubt.finger_share,
        "across_mm": doubt.middle_mm,
        "encoder_mm": doubt.encoder_mm,
        "gain": doubt.encoder_gain,
    }


def _middles(job: Job, n: int) -> Traits:
    """Traits (n,) as planned, except that a trait with an interval in [doubt] has the interval's middle.

    `across_mm` is not yet corrected for the calibration of the hand, see `_with_doubts`.
    """
    traits = as_planned(n)
    for name, interval in _intervals(job).items():
        traits[name] = 0.5 * sum(interval)
    return traits


def _draws(job: Job, rng: Generator) -> list[tuple[str, Callable[[int], Array | IntArray]]]:
    """The traits that the job doubts, each with a function that draws n values other than the planned one."""
    others, tolerance_mm = len(latent_surfaces(job)), job.part.tolerance_mm
    low, high = sorted((max(job.doubt.least_dof, 1), job.pressure.wishart_dof))
    draws: list[tuple[str, Callable[[int], Array | IntArray]]] = [
        (name, partial(_within, interval, rng=rng))
        for name, interval in _intervals(job).items()
        if any(interval)
    ]
    if others:
        draws.append(("surface", lambda n: rng.integers(1, 1 + others, n)))
    if job.doubt.least_dof:
        logs = np.log(low), np.log(high)
        draws.append(("dof", lambda n: np.exp(rng.uniform(*logs, n)).astype(np.int64)))
    if tolerance_mm:
        draws.append(("deviation", partial(_deviations, tolerance_mm, rng=rng)))
    return draws


def _friction(job: Job, n: int, rng: Generator) -> Array:
    """Draws friction (n,) outside the job's bounds for a share `friction.doubt` of the parts.

    For one half of these parts it lies between `SLIPPERY` times the lower bound and the lower bound, for the
    other half between the upper bound and `ROUGH` times the upper bound. All other parts get `FRESH`: every
    squeeze draws their friction anew.
    """
    low, high = job.friction.finger_part_min, job.friction.finger_part_max
    slippery = rng.uniform(SLIPPERY * low, low, n)
    rough = rng.uniform(high, ROUGH * high, n)
    friction = np.where(rng.random(n) < 0.5, slippery, rough)
    friction[rng.random(n) >= job.friction.doubt] = FRESH
    return friction


def _within(interval: Interval, n: int, rng: Generator) -> Array:
    """Draws values (n,) by the arcsine law, since faults that matter lie near the ends of their interval."""
    low, high = interval
    aside = np.sin(np.pi * (rng.random(n) - 0.5))
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * aside)


def _deviations(tolerance_mm: float, n: int, rng: Generator) -> Array:
    """Draws deviations (n, SHAPES) of the parts' outlines from the nominal outline [mm].

    The first column, an offset, is 0 in a random half of the parts; so is the second, a change of scale, in
    another random half. The other columns, waves along the outline, deviate in all parts.
    """
    shapes = np.empty((n, SHAPES))
    for k in range(2):
        shapes[:, k] = _within((-tolerance_mm, tolerance_mm), n, rng) * (rng.random(n) < 0.5)
    spread = tolerance_mm * WAVY / np.sqrt(0.5 * (SHAPES - 2))
    shapes[:, 2:] = spread * rng.standard_normal((n, SHAPES - 2))
    return shapes


def stated(job: Job, n: int) -> Traits:
    """The traits (n,) of parts as planned: the middle of each doubt's interval."""
    traits = _middles(job, n)
    traits["across_mm"] += closing_mm(job) * traits["share"]
    return traits


def closing_mm(job: Job) -> float:
    """Distance that the jaws close from fully open to the least width of the part [mm]."""
    return float(job.gripper.opening_mm - min_width(job.part.outline_mm))
