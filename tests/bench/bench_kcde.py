"""Measures how fast final poses are drawn from the learned motion model, by our kernel and with scipy.

    python tests/bench/bench_kcde.py [--repeat 30]

5000 particles of the rectangle's belief are drawn on one core from the paper's estimate of 10 000 points,
with h1 = h2 = 0.5 mm and the nearest 400 points. Our kernel and scipy's cKDTree draw in turn, in one process;
the medians of their times are compared.

Prints figures and writes `results/kcde.json` beside this file. Not part of `tools/check`.
"""

import math
import platform
import time
from collections.abc import Callable
from typing import Any

import harness
import numpy as np
import scipy
from kcde_twin import energy_distance
from problems import OUTLINES, random_poses, simulator
from scipy.spatial import cKDTree

from planner.learned.kcde import BANDWIDTH_MM, NEIGHBOURS, Kcde
from planner.learned.rollouts import RollOuts, roll_outs
from planner.mechanics.clearance import TOUCHES, classify_contact

RESULTS = harness.Kept("kcde")
POINTS, PARTICLES, RADIUS_MM, ORDER = 10_000, 5000, 12.75, 2
SHUFFLES = 100


def estimate(count: int) -> tuple[Kcde, RollOuts]:
    """The paper's density estimate, and the `count` roll-outs that it is made from.

    The fingers touch the part in all of these roll-outs.
    """
    part = simulator(OUTLINES["rectangle"]())
    rolled = roll_outs(part, 3 * RADIUS_MM, 2 * count)
    touching = np.flatnonzero(classify_contact(part.outline, part.jaws, rolled.initial) == TOUCHES)
    rows = np.random.default_rng(0).permutation(touching)[:count]
    chosen = RollOuts(*(column[rows] for column in rolled))
    return Kcde.fit(chosen, part.outline, part.jaws, part.surface.rho_mm, ORDER), chosen


def with_scipy(
    rows: RollOuts, rho: float, order: int
) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    """Returns a function that draws final poses as our kernel does, but with scipy.

    For each pose it takes the nearest 400 points, picks one of them by its weight, and adds noise.
    """
    period, scale = rho * math.tau / order, np.array([1.0, 1.0, rho])

    def points(poses: np.ndarray) -> np.ndarray:
        normalised = poses * scale
        normalised[:, 2] %= period
        return normalised

    tree = cKDTree(points(rows.initial), boxsize=[0.0, 0.0, period])

    def draw(poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        distance, near = tree.query(points(poses), NEIGHBOURS, workers=1)
        farther = (distance**2 - distance[:, :1] ** 2) / BANDWIDTH_MM**2
        weight = np.cumsum(np.exp(-0.5 * farther), axis=1)
        picked = (rng.random((len(poses), 1)) * weight[:, -1:] > weight).sum(axis=1)
        source = near[np.arange(len(poses)), picked]
        return rows.final[source] + BANDWIDTH_MM * rng.standard_normal(poses.shape) / scale

    return draw


def seconds(calls: list[Callable[[], Any]], repeat: int) -> list[float]:
    """Median times of the calls [s], which are made in turn, `repeat` times."""
    times = np.empty((repeat, len(calls)))
    for row in times:
        for k, call in enumerate(calls):
            start = time.perf_counter()
            call()
            row[k] = time.perf_counter() - start
    return [float(t) for t in np.median(times, axis=0)]


def p_value(ours: np.ndarray, theirs: np.ndarray, rho: float, order: int) -> float:
    """The p-value of a permutation test of whether two samples are of one distribution."""
    rng, n = np.random.default_rng(4), len(ours)
    pooled = np.concatenate([ours, theirs])
    apart = energy_distance(ours, theirs, rho, order)
    mixed = (rng.permutation(pooled) for _ in range(SHUFFLES))
    return float(np.mean([energy_distance(mix[:n], mix[n:], rho, order) >= apart for mix in mixed]))


def main() -> None:
    """Runs the benchmark and writes its figures."""
    parser = harness.parser(__doc__)
    parser.add_argument("--repeat", type=int, default=30)
    options = parser.parse_args()
    model, rows = estimate(POINTS)
    draw = with_scipy(rows, model.rho_mm, ORDER)
    rng = np.random.default_rng(1)
    poses = random_poses(rng, PARTICLES, RADIUS_MM)
    touched = poses[classify_contact(model.outline, model.jaws, poses) == TOUCHES]
    first, second = model.sample(touched[:2000], rng).poses, draw(touched[:2000], rng)
    calls = [lambda: model.sample(poses, rng), lambda: draw(poses, rng)]
    ours_s, scipy_s = seconds(calls, options.repeat)
    row = {
        "points": POINTS,
        "particles": PARTICLES,
        "ours_ms": 1e3 * ours_s,
        "scipy_ms": 1e3 * scipy_s,
        "ratio": scipy_s / ours_s,
        "particles_per_second": PARTICLES / ours_s,
        "same_distribution_p": p_value(first, second, model.rho_mm, ORDER),
        "setting": {
            "python": platform.python_version(),
            "scipy": scipy.__version__,
            "machine": platform.machine(),
            "cores_used": 1,
        },
    }
    harness.show(row)
    RESULTS.write(row)


if __name__ == "__main__":
    main()
