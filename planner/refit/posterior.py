"""The posterior of a cell, given what was seen in it: population Monte Carlo, then an emulated likelihood.

Rounds of cells are drawn nearer and nearer to those that explain what was seen (Cappe et al. 2004, with
tempered weights). A simulated likelihood is noisy. A Gaussian process over all cells near the best averages
the noise out; the next round, and at last the posterior, are drawn from it.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import softmax
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from planner.arrays import Array, IntArray
from planner.evaluation.expectation import readings
from planner.refit.cells import Cells, Space
from planner.refit.likelihood import Seen, log_likelihood, usual
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler

SURFACE_FEATURES = 2
HEAVY = 0.1  # share of each round's cells that are drawn from the prior
DEEP = 30.0  # how much less likely than the best a cell is that the Gaussian process still looks at
EFFECTIVE = 15.0  # cells that share the weight, at the power from which a round goes on
TEMPER = 0.25  # power of the likelihood in the posterior, or 90 % intervals cover too few (decision 0034)
LEAST_NOISE = 0.3  # variance of a simulated likelihood, or the process follows chance
HURRY = 3.0  # and how much higher the next round's power is
COARSE = 3  # so many times fewer parts are simulated in the first half of the rounds
MOST_NEAR = 400
LEAST_NEAR = 100  # cells that it looks at in any case
USUAL_CELLS, USUAL_PARTS = 120, 200  # of the prior, simulated to know what is usual
DRAWN = 2_000  # cells of the posterior
STEPS = 60  # of each one's chain

Task = tuple[Array, int, int]  # a cell to simulate: its point (d + 1,), how many parts, and the seed


class Effort(NamedTuple):
    """How much is simulated."""

    rounds: int = 7
    cells: int = 100  # in each round; twice as many in the first
    parts: int = 600  # in each cell, at least
    parts_for_each: float = 4.0  # for each part seen

    def parts_for(self, seen: Seen) -> int:
        """Parts to simulate in each cell."""
        return max(self.parts, round(self.parts_for_each * seen.parts))


USUAL = Effort()


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Cells (n, d + 1) as likely as each other, and how surely the best of them explains what was seen."""

    cells: Array
    space: Space

    def of(self, key: str) -> Array:
        """The values (n,) of one quantity."""
        return np.asarray(self.cells[:, self.space.column(key)])


def posterior(
    cells: Cells, seen: Seen, seed: int, scheduler: Scheduler, effort: Effort = USUAL,
    report: Report = silent,
) -> Posterior:  # fmt: skip
    """Draws cells from the posterior, given what was seen."""
    rng = np.random.default_rng([seed, 0x504F53])
    expected = _expected(cells, rng, scheduler)
    points = cells.space.draw(2 * effort.cells, rng)
    tried, found = np.empty((0, points.shape[1])), np.empty(0)
    for turn in range(effort.rounds):
        parts = effort.parts_for(seen) // (1 if turn >= effort.rounds // 2 else COARSE)
        jobs = [(point, parts, int(rng.integers(2**31))) for point in points]
        likelihoods = []
        for value in scheduler.map(partial(_likelihood, cells, seen, expected), jobs):
            likelihoods.append(value)
            done, total = len(found) + len(likelihoods), (effort.rounds + 1) * effort.cells
            report("simulating cells", done, total, f"round {turn + 1}")
        tried, found = np.concatenate([tried, points]), np.concatenate([found, likelihoods])
        if turn + 1 < effort.rounds:
            points = _next(cells, tried, found, effort.cells, rng)
    report("weighing", 0, 0)
    # Fewer parts make a likelihood another, not just noisier: the last word is that of the fine rounds.
    coarse = effort.cells * (1 + effort.rounds // 2) if effort.rounds > 1 else 0
    tried, found = tried[coarse:], found[coarse:]
    return Posterior(_emulated(cells, tried, found, TEMPER, DRAWN, rng), cells.space)


def _expected(cells: Cells, rng: np.random.Generator, scheduler: Scheduler) -> Array:
    """What each node reads in cells of the prior, shares (nodes, 256)."""
    points = cells.space.draw(USUAL_CELLS, rng)
    jobs = [(point, USUAL_PARTS, int(rng.integers(2**31))) for point in points]
    return usual(np.sum(list(scheduler.map(partial(_readings, cells), jobs)), axis=0), cells.program.table)


def _readings(cells: Cells, task: Task) -> IntArray:
    return readings(cells.run(*task), len(cells.program.table.nodes))


def _likelihood(cells: Cells, seen: Seen, expected: Array, task: Task) -> float:
    return log_likelihood(seen, cells.run(*task), cells.program.table, expected)


def _next(cells: Cells, tried: Array, found: Array, n: int, rng: np.random.Generator) -> Array:
    """The next round (n, d + 1): cells that explain what was seen, as far as is known, some from anywhere."""
    anywhere = round(HEAVY * n)
    power = min(1.0, HURRY * _power(found, EFFECTIVE))
    return np.concatenate([
        _emulated(cells, tried, found, power, n - anywhere, rng), cells.space.draw(anywhere, rng)
    ])  # fmt: skip


def _power(found: Array, effective: float) -> float:
    """The highest power up to 1 of likelihoods (n,) by which as many cells are effective."""
    effective = min(effective, 0.9 * len(found))

    def short(power: float) -> float:
        return float(1.0 / np.sum(softmax(power * found) ** 2)) - effective

    return 1.0 if short(1.0) >= 0.0 else float(brentq(short, 0.0, 1.0))


def _bandwidth(tried: Array, weights: Array) -> Array:
    """A root (d, d) of the covariance of steps among weighted points: Silverman's share of their own."""
    centres = tried[:, :-1]
    d, effective = centres.shape[1], 1.0 / np.sum(weights**2)
    factor = (4.0 / ((d + 2.0) * effective)) ** (1.0 / (d + 4.0))
    covariance = np.cov(centres.T, aweights=weights) + 1e-10 * np.diag(np.ptp(centres, axis=0) ** 2)
    return np.asarray(factor * np.linalg.cholesky(covariance))


def _emulated(
    cells: Cells, tried: Array, found: Array, power: float, n: int, rng: np.random.Generator
) -> Array:
    """Draws (n, d + 1) from the posterior of likelihoods to a power, as a Gaussian process has them."""
    space = cells.space
    near = np.argsort(-found)[: max(LEAST_NEAR, int(np.sum(found > found.max() - DEEP / power)))][:MOST_NEAR]
    tried, levels = tried[near], power * found[near]
    weights = softmax(_power(levels, EFFECTIVE) * levels)
    features = _features(cells, tried, weights)
    floor = max(
        levels.min(), levels.max() - DEEP
    )  # far from all cells tried, where the process knows nothing
    lengths = RBF(np.full(features(tried).shape[1], 3.0), (0.5, 50.0))
    kernel = ConstantKernel(200.0, (10.0, 1e4)) * lengths + WhiteKernel(2.0, (LEAST_NOISE, 50.0))
    with warnings.catch_warnings():  # a quantity that does not matter has a length without bounds
        warnings.simplefilter("ignore", ConvergenceWarning)
        process = GaussianProcessRegressor(kernel).fit(features(tried), levels - floor)

    def density(points: Array) -> Array:
        with np.errstate(divide="ignore"):
            return np.asarray(process.predict(features(points)) + np.log(space.density(points)))

    starts = tried[rng.choice(len(tried), n, p=weights)]
    return _chains(space, density, starts, _bandwidth(tried, weights), rng)


def _chains(
    space: Space, density: Callable[[Array], Array], points: Array, spread: Array, rng: np.random.Generator
) -> Array:
    """Where chains (n, d + 1) stand that began at points, after `STEPS` steps of Metropolis' algorithm."""
    n, level = len(points), density(points)
    for _ in range(STEPS):
        moved = points[:, :-1] + rng.standard_normal((n, len(spread))) @ spread.T
        surface = np.where(rng.random(n) < 0.8, points[:, -1], rng.integers(0, space.surfaces, n))
        proposed = np.column_stack([moved, surface])
        reached = density(proposed)
        taken = np.log(rng.random(n)) < reached - level
        points, level = np.where(taken[:, None], proposed, points), np.where(taken, reached, level)
    return points


def _features(cells: Cells, tried: Array, weights: Array) -> Callable[[Array], Array]:
    """What the process is a function of: quantities in units of their spread, and what surfaces are like."""
    centre = np.average(tried[:, :-1], axis=0, weights=weights)
    spread = np.sqrt(np.average((tried[:, :-1] - centre) ** 2, axis=0, weights=weights)) + 1e-12
    entries = cells.surface_entries()
    main = np.linalg.svd(entries - entries.mean(axis=0), full_matrices=False)
    alike = (main[0] * main[1])[:, :SURFACE_FEATURES]
    alike = 2.0 * alike / max(alike.std(), 1e-12)

    def features(points: Array) -> Array:
        moved = (points[:, :-1] - centre) / spread
        return np.column_stack([moved, alike[points[:, -1].astype(np.int64)]])

    return features
