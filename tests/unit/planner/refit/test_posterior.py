"""The posterior where the likelihood is known: what it draws has the moments of the exact one."""

import numpy as np
import pytest
from scipy.stats import chisquare

from planner.refit import posterior as refit
from planner.refit.cells import Quantity, Space
from planner.refit.likelihood import Seen
from planner.refit.posterior import Effort, posterior
from planner.work.scheduler import Threads

SPACE = Space(
    (
        Quantity("encoder_mm", -3.0, 3.0),
        Quantity("finger_part_min", 0.0, 1.0),
        Quantity("finger_part_max", 0.0, 1.0),
    ),
    surfaces=2,
)
SIGMA = np.array([0.05, 0.04, 0.04])
NOISE = 1.0  # standard deviation of a simulated likelihood
NOTHING = Seen(np.zeros((1, 256), np.int64), 100, np.zeros(0, np.int64), np.zeros((0, 3)))


class Plain:
    space = SPACE

    def surface_entries(self):
        return np.array([[1.0, 0.0], [0.0, 1.0]])


def drawn(monkeypatch, measured, seed, surface_gain=0.0):
    """Cells of the posterior where measurements are normal about the truth."""

    def likelihood(cells, seen, expected, job):
        point, _, number = job
        off = (point[:3] - measured) / SIGMA
        noise = NOISE * np.random.default_rng(number).standard_normal()
        return float(-0.5 * off @ off + surface_gain * point[3] + noise)

    monkeypatch.setattr(refit, "_likelihood", likelihood)
    monkeypatch.setattr(refit, "_expected", lambda *_: None)
    monkeypatch.setattr(refit, "DRAWN", 300)
    return posterior(Plain(), NOTHING, seed, Threads(1), Effort(cells=50)).cells


def test_it_has_the_moments_of_the_exact_posterior(monkeypatch):
    measured = np.array([1.2, 0.3, 0.7])
    cells = drawn(monkeypatch, measured, 1, surface_gain=6.0)
    wide = SIGMA / np.sqrt(refit.TEMPER)  # by the tempered likelihood
    assert cells[:, :3].mean(axis=0) == pytest.approx(measured, abs=0.6 * wide.max())
    spread = cells[:, :3].std(axis=0) / wide
    assert (spread > 0.6).all()
    assert (spread < 1.6).all()
    assert np.mean(cells[:, 3] == 1.0) == pytest.approx(1.0 / (1.0 + np.exp(-6.0 * refit.TEMPER)), abs=0.1)


def test_ranks_of_the_truth_are_uniform(monkeypatch):
    rng, ranks = np.random.default_rng(5), []
    for number in range(8):
        truth = SPACE.draw(1, rng)[0, :3]
        measured = truth + SIGMA * rng.standard_normal(3)
        ranks.append((drawn(monkeypatch, measured, number)[:, :3] < truth).mean(axis=0))
    pooled = np.ravel(ranks)
    assert chisquare(np.histogram(pooled, 5, (0.0, 1.0))[0]).pvalue > 1e-3
    assert 0.75 < np.mean((pooled >= 0.05) & (pooled <= 0.95)) <= 1.0


def test_the_same_seed_draws_the_same_cells(monkeypatch):
    first, second = (drawn(monkeypatch, np.array([0.0, 0.2, 0.5]), 3) for _ in range(2))
    assert np.array_equal(first, second)
