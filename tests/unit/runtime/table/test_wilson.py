"""Wilson's interval."""

import numpy as np
import pytest
from scipy.stats import binom

from runtime.table import refuted, wilson_interval


def test_ends_solve_wilsons_equation():
    for hits, trials in [(0, 10), (3, 10), (19, 20), (20, 20), (970, 1000)]:
        for bound in wilson_interval(hits, trials):
            gap = abs(hits / trials - bound)
            assert gap == pytest.approx(1.959963984540054 * np.sqrt(bound * (1 - bound) / trials), abs=1e-9)


def test_without_trials_nothing_is_known():
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_coverage_is_about_95_percent():
    rng = np.random.default_rng(0)
    hits = rng.binomial(200, 0.97, size=4000)
    covered = [low <= 0.97 <= high for low, high in (wilson_interval(int(h), 200) for h in hits)]
    assert np.mean(covered) == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99, 0.999])
def test_a_leaf_is_refuted_where_the_binomial_test_says_so(confidence):
    for trials in (1, 7, 18, 100, 2000):
        for misses in range(min(trials, 60) + 1):
            hits = trials - misses
            level = binom.cdf(hits, trials, confidence)
            if abs(level - 0.025) > 1e-9:
                assert refuted(hits, trials, confidence) == (level < 0.025)


def test_a_leaf_without_trials_is_not_refuted_and_one_of_many_misses_is():
    assert not refuted(0, 0, 0.99)
    assert refuted(40_000, 100_000, 0.5)
    assert refuted(900_000, 1_000_000, 0.99)
