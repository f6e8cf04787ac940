"""Figures of a table: the test of a leaf's share equals other methods; contradictions are refused."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_tables import changed, small_table
from scipy.stats import binom, binomtest

from runtime.table import TableError, dumps, refuted, wilson_interval
from runtime.table.evidence import LEAST_LOG, LEVEL, MOST_TERMS, Z95


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.99, 0.999])
@pytest.mark.parametrize("trials", [0, 1, 2, 10, 57, 300])
def test_refuted_few_trials_equals_exact_binomial_test(trials, confidence):
    """The exact test is the lower tail of the binomial distribution (Clopper and Pearson 1934)."""
    tails = binom.cdf(range(trials + 1), trials, confidence)
    for successes, tail in enumerate(tails):
        if abs(tail - LEVEL) > 1e-9:
            assert refuted(successes, trials, confidence) == (tail < LEVEL), (successes, trials)


def test_refuted_many_misses_equals_wilson_interval():
    assert (MOST_TERMS, LEVEL, LEAST_LOG) == (1_000, 0.025, -700.0)
    assert pytest.approx(1.959964, abs=1e-6) == Z95  # two-sided 95 %
    for trials, confidence in ((100_000, 0.99), (20_000, 0.9), (10**9, 0.999)):
        for misses in range(1_001, 3_000, 97):
            successes = trials - misses
            above = wilson_interval(successes, trials)[1]
            assert refuted(successes, trials, confidence) == (above < confidence)


@pytest.mark.parametrize("trials", [50, 300, 200_000])
def test_refuted_many_leaves_keeps_total_error_at_level(trials):
    """Bonferroni: if all leaves are just good enough, the chance that any is refuted is at most 2.5 %."""
    for leaves in (1, 30, 400):
        least = next(n for n in range(trials) if refuted(trials - n, trials, 0.99, leaves))
        chance = binom.cdf(trials - least, trials, 0.99)
        slack = 1.0 if trials < 1000 else 1.5  # the score test is not exact
        assert leaves * chance < LEVEL * slack
        assert leaves * binom.cdf(trials - least + 1, trials, 0.99) > LEVEL * 0.9


def test_refuted_probability_underflow_does_not_refute():
    """0.5 ** 2000 underflows to 0, so that every number of successes would seem impossible."""
    assert not refuted(1_000, 2_000, 0.5)
    assert refuted(900, 2_000, 0.5)
    assert not refuted(700, 700, 0.37)  # exp(-696) is still a float
    assert not refuted(260, 701, 0.37)


def test_refuted_at_confidence_one_any_miss_refutes():
    """Without a miss, no number of trials refutes a confidence of 1."""
    assert not refuted(10**6, 10**6, 1.0)
    assert refuted(10**6 - 1, 10**6, 1.0)
    assert refuted(0, 10**10, 1.0)
    assert wilson_interval(0, 0) == (0.0, 1.0)


@given(st.integers(0, 200), st.integers(1, 200))
def test_wilson_interval_equals_scipy(successes, trials):
    theirs = binomtest(min(successes, trials), trials).proportion_ci(0.95, "wilson")
    ours = wilson_interval(min(successes, trials), trials)
    assert ours == pytest.approx((theirs.low, theirs.high), abs=1e-9)


TABLE = small_table()


@pytest.mark.parametrize(
    ("record", "values", "said"),
    [
        ("leaves.1", {"success_ppm": 995_002}, "success_ppm is 995002, no share of 3000 trials"),
        ("leaves.1", {"success_ppm": 990_000, "trials": 7}, "is 990000, no share of 7 trials"),
        ("leaves.1", {"error_p95_um": 3_001}, "is 3001, but 2985 of 3000 trials lay within"),
        ("leaves.1", {"error_median_um": 3_001, "error_p95_um": 3_001}, "error_median_um is 3001"),
        ("predicted", {"success_ppm": 1_000_000}, "10000 of 10000 trials, but only 9589 met"),
        ("predicted", {"reject_ppm": 42_002}, "ppm is 958000, but 42002 ppm were rejected"),
        ("predicted", {"mean_squeezes_ppm": 4_000_001}, "allowed is 958000..4000000"),
        ("predicted", {"mean_squeezes_ppm": 957_999}, "allowed is 958000..4000000"),
    ],
)
def test_validate_figures_contradictory_values_are_refused(record, values, said):
    table = changed(TABLE, {f"{record}.{name}": value for name, value in values.items()})
    with pytest.raises(TableError, match=re.escape(said)):
        dumps(table)


def test_validate_figures_fewer_squeezes_than_parts_pass():
    dumps(changed(TABLE, {"predicted.mean_squeezes_ppm": 990_000}))


def test_validate_figures_of_any_evaluation_pass():
    """The figures are those of random errors; quantiles are interpolated as the planner does."""
    rng = np.random.default_rng(0)
    for trials in [*range(1, 60), 400]:
        errors = rng.exponential(rng.uniform(200, 2_500), trials)
        hits = int((errors < TABLE.goal.distance_um).sum())
        median, high = map(round, np.quantile(errors, (0.5, 0.95)))
        figures = {"success_ppm": round(1e6 * hits / trials), "trials": trials, "resolved": False}
        leaf = TABLE.leaves[1]._replace(**figures, error_median_um=median, error_p95_um=high)
        dumps(changed(TABLE, {"leaves.1": leaf, "predicted.trials": 0}))
