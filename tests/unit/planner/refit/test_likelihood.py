"""The synthetic likelihood against exact ones, for parts with a few possible outcomes."""

import numpy as np
import pytest

from planner.refit.likelihood import Likelihood
from planner.refit.outcomes import LINE

PARTS = 100


def shares(feature):
    """Probabilities (m, 4) of four outcomes in m cells.

    The greater a cell's `feature` (m,), the more probable is the first outcome. The last outcome is rare.
    """
    first = 1.0 / (1.0 + np.exp(-feature))
    return np.stack(
        [0.6 * first, 0.6 * (1.0 - first), np.full_like(first, 0.397), np.full_like(first, 0.003)],
        1,
    )


def simulated(feature, rng, parts=PARTS):
    """Random outcomes (m, 2, parts, 1) of m cells: two independent sets of parts in each."""
    ends = shares(feature).cumsum(axis=1)[:, None, None]
    return (rng.random((len(feature), 2, parts, 1, 1)) > ends[..., None, :]).sum(axis=-1)


def learned(seen, rng, other=1, cells=300):
    """The likelihood of the outcomes `seen`, learned from simulated cells.

    The cells have one feature that determines the outcomes and `other` features without effect.
    """
    features = rng.uniform(-1.0, 1.0, (cells, 1 + other))
    return Likelihood.of(features, simulated(features[:, 0], rng), seen, len(seen))


@pytest.mark.parametrize("first", [18, 30, 42])
def test_likelihood_with_one_sufficient_statistic_equals_the_exact(first):
    rng, at = np.random.default_rng(1), np.linspace(-1.0, 1.0, 9)
    seen = np.array([first, 60 - first, 40, 0], np.float64)
    exact = (seen * np.log(shares(at))).sum(axis=1)
    likely = exact > exact.max() - 4.0
    lines = [learned(seen, rng).log(np.stack([at, 0.0 * at], 1)) for _ in range(8)]
    off = np.mean(lines, axis=0)[likely] - exact[likely]
    assert np.ptp(off) < 0.6


def test_likelihood_ratio_of_the_truth_is_chi_square_distributed():
    """Twice the log likelihood ratio of the best and the true cell is chi-square distributed (Wilks 1938)."""
    rng, at = np.random.default_rng(3), np.linspace(-1.5, 1.5, 61)[:, None]
    ratios = []
    for truth in np.linspace(-0.7, 0.7, 60):
        seen = np.bincount(simulated(np.full(1, truth), rng)[0, 0].ravel(), minlength=4).astype(
            np.float64
        )
        result = learned(seen, rng, other=0, cells=120)
        ratios.append(2.0 * (result.log(at).max() - result.log(np.full((1, 1), truth))[0]))
    assert np.mean(np.array(ratios) < 2.71) == pytest.approx(0.9, abs=0.09)


def test_likelihood_on_a_line_extrapolates_beyond_simulated_parts():
    """The readings, near 205, lie beyond those of nearly all simulated parts."""
    rng = np.random.default_rng(6)
    features = rng.uniform(-1.0, 1.0, (300, 1))
    at = 130.0 + 40.0 * features[:, :1, None, None] + 10.0 * rng.standard_normal((300, 2, PARTS, 1))
    seen = np.bincount(np.rint(205.0 + rng.standard_normal(PARTS)).astype(np.int64), minlength=LINE)
    result = Likelihood.of(features, np.rint(at).astype(np.int64), seen.astype(np.float64), 0)
    best = np.linspace(0.0, 3.0, 301)
    assert best[np.argmax(result.log(best[:, None]))] == pytest.approx(75.0 / 40.0, abs=0.1)
