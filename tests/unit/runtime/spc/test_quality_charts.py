"""Control charts: distributions equal SciPy's, a healthy cell hardly alarms, drift is flagged quickly."""

import numpy as np
import pytest
from histories import SHIFT_UM, drawn, history, table, watch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from runtime.spc.charts import (
    CLIP,
    WINDOW,
    BinomialWindowChart,
    Cusum,
    Ewma,
    GTestChart,
    binomial_tail,
    chi_square,
    chi_square_tail,
    likelihood_ratio,
)
from runtime.spc.history import NodeReading
from runtime.spc.monitor import branch_shares, deviation

TABLE = table()
BEFORE = 300


@given(st.floats(1e-3, 400.0), st.integers(1, 120))
def test_chi_square_tail_equals_scipy(statistic, freedom):
    theirs = stats.chi2.sf(statistic, freedom)
    assert chi_square_tail(statistic, freedom) == pytest.approx(theirs, rel=1e-8, abs=1e-13)


@settings(max_examples=40)
@given(st.integers(0, 60), st.integers(1, 60), st.floats(1e-4, 0.9))
def test_binomial_tail_equals_scipy(least, trials, share):
    theirs = stats.binom.sf(least - 1, trials, share)
    assert binomial_tail(least, trials, share) == pytest.approx(theirs, rel=1e-8, abs=1e-14)


STATISTICS = [(chi_square, "pearson"), (likelihood_ratio, "log-likelihood")]


@pytest.mark.parametrize(("statistic", "name"), STATISTICS)
def test_chi_square_and_likelihood_ratio_equal_scipy(statistic, name):
    counts, shares = [30, 50, 20], [0.2, 0.5, 0.3]
    theirs = stats.power_divergence(counts, 100 * np.array(shares), lambda_=name)
    ours, freedom = statistic(counts, shares)
    assert ours == pytest.approx(theirs.statistic)
    assert chi_square_tail(ours, freedom) == pytest.approx(theirs.pvalue)


def test_chi_square_p_values_of_multinomial_samples_are_uniform():
    # Kolmogorov and Smirnov's test on the p-values of multinomial samples.
    rng = np.random.default_rng(1)
    shares = [0.41, 0.18, 0.13, 0.28]
    tails = []
    for _ in range(400):
        statistic, freedom = chi_square(rng.multinomial(200, shares).tolist(), shares)
        tails.append(chi_square_tail(statistic, freedom))
    assert stats.kstest(tails, "uniform").pvalue > 0.001


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_cusum_shift_either_way_alarms_and_restarts(way):
    rng, chart = np.random.default_rng(2), Cusum(shift=1.0)
    assert not any(chart.add(value, 1.0) for value in rng.normal(0.0, 1.0, 5_000))
    alarms = [chart.add(value, 1.0) for value in rng.normal(way, 1.0, 200)]
    assert alarms.index(True) < 60
    assert sum(alarms) > 2


def test_ewma_mean_is_weighted_and_limit_is_asymptotic():
    rng, chart = np.random.default_rng(3), Ewma(width=np.inf)
    values = rng.normal(0.0, 1.0, 5000).clip(-CLIP, CLIP)
    means = []
    for value in values:
        chart.add(value)
        means.append(chart.mean)
    weights = 0.1 * 0.9 ** np.arange(200)[::-1]
    assert means[-1] == pytest.approx(float(weights @ values[-200:]), abs=1e-8)
    assert np.std(means) == pytest.approx(Ewma(width=1.0).limit, rel=0.15)


def test_binomial_window_chart_alarms_only_at_raised_share():
    rng, chart = np.random.default_rng(4), BinomialWindowChart(0.01)
    assert not any(chart.add(bool(had)) for had in rng.random(5_000) < 0.01)
    alarms = [chart.add(bool(had)) for had in rng.random(50) < 0.4]
    assert True in alarms


def test_g_test_chart_alarms_only_at_changed_branch_shares():
    rng, chart = np.random.default_rng(5), GTestChart([[0.5, 0.3, 0.2]], WINDOW)
    healthy = rng.choice(3, 5000, p=[0.5, 0.3, 0.2])
    assert not any(chart.add(((0, int(branch)),)) for branch in healthy)
    changed = rng.choice(3, 50, p=[0.15, 0.8, 0.05])
    assert any(chart.add(((0, int(branch)),)) for branch in changed)


# -- all of them together, on histories drawn from a table ----------------------------------------


def test_watch_healthy_cell_raises_at_most_one_alarm():
    """By tests/bench/drift_trials.py, 100 000 parts raise about four false alarms; here 4000 parts run."""
    parts = [drawn(TABLE, 2000, np.random.default_rng(seed)) for seed in range(2)]
    assert sum(len(watch(history(TABLE, each))) for each in parts) <= 1


@pytest.mark.parametrize(
    ("drift", "charts"),
    [
        (
            {"width_shift_um": SHIFT_UM},
            {"widths", "branches"},
        ),  # a fine partition shows in its branches
        ({"width_shift_um": -SHIFT_UM}, {"widths", "branches"}),
        ({"shares": {0: [0.3, 0.6, 0.0, 0.1]}}, {"branches"}),
        ({"residual_shift": (0.8, 0.0, 0.0)}, {"residual x"}),
        ({"residual_shift": (0.0, -0.8, 0.0)}, {"residual y"}),
        ({"residual_shift": (0.0, 0.0, 0.06)}, {"residual theta"}),
        ({"fail_rate": 0.3}, {"failures"}),
    ],
    ids=lambda value: " ".join(sorted(value)) if isinstance(value, (set, dict)) else None,
)
def test_watch_drift_is_flagged_by_its_chart_within_fifty_parts(drift, charts):
    rng = np.random.default_rng(7)
    result = watch(history(TABLE, drawn(TABLE, BEFORE, rng), drawn(TABLE, 60, rng, **drift)))
    assert result
    assert all(alarm.place >= BEFORE for alarm in result)
    assert charts & {alarm.chart for alarm in result if alarm.place < BEFORE + 50}


def test_deviation_of_rejected_width_refers_to_nearby_branch():
    branches = TABLE.nodes[0].branches
    just_out = branches[0].low_um - 300
    off, sigma = deviation(TABLE, NodeReading(0, None, just_out))
    assert off == just_out - branches[0].expected_um
    assert np.isfinite(sigma)
    assert deviation(TABLE, NodeReading(0, None, 80_000)) == (0.0, float("inf"))


def test_branch_shares_reproduce_leaf_probabilities():
    shares, trials = branch_shares(TABLE), [leaf.trials for leaf in TABLE.leaves]
    assert all(sum(row) == pytest.approx(1.0) for row in shares)

    def chance(target):
        """Probabilities of the leaves below the node or leaf `target`, from the branch shares alone."""
        if target < 0:
            return {~target: 1.0}
        record = {}
        for branch, share in zip(TABLE.nodes[target].branches, shares[target], strict=True):
            record |= {leaf: share * odds for leaf, odds in chance(branch.target).items()}
        return record

    for leaf, odds in chance(0).items():
        assert odds == pytest.approx(trials[leaf] / sum(trials), abs=2e-4)
