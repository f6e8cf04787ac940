"""The posterior of a cell's parameters given its journals, estimated in rounds of simulated cells.

Each round draws its cells from the estimate of the previous rounds, widened, and improves the estimate
(sequential neural likelihood, Papamakarios et al. 2019, with a polynomial instead of the network). At the end
cells are drawn from the estimated posterior itself.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import softmax

from planner.arrays import Array, IntArray
from planner.refit.cells import Cells, Space
from planner.refit.likelihood import Likelihood
from planner.refit.outcomes import Outcomes, Seen
from planner.work.progress import Report, silent
from planner.work.scheduler import Scheduler

SURFACE_FEATURES = 2  # principal components that describe a limit surface
WIDE = 0.25  # power of the likelihood between rounds; it makes the posterior twice as wide
EFFECTIVE = 15.0  # least effective number of cells at which chains start
COARSE = 2  # factor by which the first half of the rounds simulates fewer parts
DRAWN = 2_000  # number of cells drawn from the posterior
CHAINS = 300  # least number of chains; the steps of a chain depend on the spread of the others
STEPS = 200  # steps of each chain
ROOM = 0.25  # margin, as a share of the range of cells tried, in which the polynomials still hold
ACROSS = 0.1  # share of steps by the whole difference of two chains, which may lead to another mode

Task = tuple[Array, int, int]
"""A cell to simulate: its point (d + 1,), the number of pairs of sets of parts, and the seed."""


class Effort(NamedTuple):
    """The numbers of rounds, cells and parts that are simulated."""

    rounds: int = 7
    cells: int = 100  # cells in each round; twice as many in the first
    parts: int = 600  # least parts in each cell, about
    parts_for_each: float = 4.0  # least parts in each cell for each observed part, about

    def pairs_for(self, seen: Seen) -> int:
        """Number of pairs of sets to simulate in each cell.

        Each set has as many parts as the journals. A pair has one set for the scores of the likelihood, and
        one for its regression. The first half of the rounds simulates fewer pairs (`COARSE`).
        """
        return max(1, round(max(self.parts / seen.parts, self.parts_for_each) / 2.0))


USUAL = Effort()


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """Sample of the posterior: n equally likely cells as points (n, d + 1) of their space."""

    cells: Array
    space: Space

    def of(self, key: str) -> Array:
        """The values (n,) of the quantity `key` in the sample."""
        return np.asarray(self.cells[:, self.space.column(key)])


def posterior(
    cells: Cells,
    seen: Seen,
    seed: int,
    scheduler: Scheduler,
    effort: Effort = USUAL,
    report: Report = silent,
) -> Posterior:
    """Draws `DRAWN` cells from their posterior given the observations `seen`.

    The result depends on the seed and the effort, not on the scheduler.
    """
    rng = np.random.default_rng([seed, 0x504F53])
    outcomes = Outcomes(
        cells.program.table, np.isin(np.arange(len(cells.program.table.leaves)), seen.leaves)
    )
    features, counted = _features(cells), outcomes.of_seen(seen)
    points, rounds = cells.space.draw(2 * effort.cells, rng), []
    done, total = 0, (effort.rounds + 1) * effort.cells
    for turn in range(effort.rounds):
        pairs = max(1, effort.pairs_for(seen) // (1 if turn >= effort.rounds // 2 else COARSE))
        jobs = [(point, pairs, int(rng.integers(2**31))) for point in points]
        sets = []
        for one in scheduler.map(partial(_shown, cells, outcomes, seen), jobs):
            sets.append(one)
            report("simulating cells", done + len(sets), total, f"round {turn + 1}")
        done += len(sets)
        rounds.append((np.repeat(points, pairs, axis=0), np.concatenate(sets)))
        # Cells of the first rounds are far from explaining the observations.
        points, shown = map(np.concatenate, zip(*rounds[(turn + 1) // 2 :], strict=True))
        result = Likelihood.of(features(points), shown, counted, seen.readings.size)
        drawn, power = (DRAWN, 1.0) if turn + 1 == effort.rounds else (effort.cells, WIDE)
        points = _drawn(cells.space, partial(_log, result, features, power), points, drawn, rng)
    return Posterior(points, cells.space)


def _log(
    likelihood: Likelihood, features: Callable[[Array], Array], power: float, points: Array
) -> Array:
    return power * likelihood.log(features(points))


def _shown(cells: Cells, outcomes: Outcomes, seen: Seen, task: Task) -> IntArray:
    """Simulates pairs of sets of parts in one cell; returns the parts' outcome numbers (pairs, 2, n, d).

    Each set has n parts, as many as `seen` has. The second set of each pair has at most as many audited parts
    as `seen`, so that its statistics scatter like the observed ones; in the first set there is no limit.
    """
    point, pairs, seed = task
    result = outcomes.of_parts(cells.run(point, 2 * pairs * seen.parts, seed))
    shown = result.reshape(pairs, 2, seen.parts, -1)
    known = shown[:, 1, :, -3:]
    known[np.cumsum(known[..., 0] < outcomes.size, axis=1) > len(seen.leaves)] = outcomes.size
    return shown


def _drawn(
    space: Space, log: Callable[[Array], Array], tried: Array, n: int, rng: np.random.Generator
) -> Array:
    """Draws n points (n, d + 1) from the prior times a likelihood, by Markov chains.

    Each point stands for a cell. The chains start at points drawn from `tried`, likely ones more often, and
    stay near the range of these points. A step goes along the difference of two random chains (differential
    evolution, ter Braak 2006).

    Args:
        space: the prior.
        log: logarithm of the likelihood at points.
        tried: points that were simulated before.
        n: number of points.
        rng: source of randomness.
    """
    level = log(tried)
    weights = softmax(_power(level, EFFECTIVE) * level)
    points = tried[rng.choice(len(tried), max(n, CHAINS), p=weights)]

    low, high = tried[:, :-1].min(axis=0), tried[:, :-1].max(axis=0)

    def density(at: Array) -> Array:
        off = np.abs(2.0 * at[:, :-1] - low - high)
        known = (off <= (1.0 + 2.0 * ROOM) * (high - low)).all(axis=1)
        with np.errstate(divide="ignore"):
            return np.asarray(log(at) + np.log(known * space.density(at)))

    level, chains = density(points), len(points)
    usual = 1.68 / np.sqrt(points.shape[1] - 1)
    for _ in range(STEPS):
        one, two = points[rng.integers(0, chains, (2, chains)), :-1]
        far = np.where(rng.random(chains) < ACROSS, 1.0, usual)
        kept = rng.random(chains) < 0.5
        surface = np.where(kept, points[:, -1], rng.integers(0, space.surfaces, chains))
        proposed = np.column_stack([points[:, :-1] + far[:, None] * (one - two), surface])
        reached = density(proposed)
        taken = np.log(rng.random(chains)) < reached - level
        points, level = np.where(taken[:, None], proposed, points), np.where(taken, reached, level)
    return np.asarray(points[:n])


def _power(likelihoods: Array, effective: float) -> float:
    """Returns an exponent that evens out the likelihoods of n cells, so that a few cells do not dominate.

    Each cell has its likelihood, raised to the exponent, as weight. The exponent is the largest one up to 1
    for which the effective sample size of these weights is at least `effective`, or 0.9 n if that is less.
    `likelihoods` (n,) holds logarithms.
    """
    effective = min(effective, 0.9 * len(likelihoods))

    def short(power: float) -> float:
        return float(1.0 / np.sum(softmax(power * likelihoods) ** 2)) - effective

    return 1.0 if short(1.0) >= 0.0 else float(brentq(short, 0.0, 1.0))


def _features(cells: Cells) -> Callable[[Array], Array]:
    """Returns a function that maps points (n, d + 1) of cells to features (n, k).

    The features are the quantities, then the principal components of the limit surface.
    """
    entries = cells.surface_entries()
    main = np.linalg.svd(entries - entries.mean(axis=0), full_matrices=False)
    alike = (main[0] * main[1])[:, :SURFACE_FEATURES]
    return lambda points: np.column_stack([points[:, :-1], alike[points[:, -1].astype(np.int64)]])
