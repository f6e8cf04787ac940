"""Gauge studies: AIAG's published examples to their digits, and properties of any study."""

from math import sqrt
from statistics import stdev

import numpy as np
import pytest
from gauge_readings import AIAG, AIAG_BIAS
from hypothesis import given
from hypothesis import strategies as st
from scipy import special, stats

from runtime.spc.study.gauge import beta_share, crossed, f_tail, t_tail, type_one

PARTS = ("repeatability", "reproducibility", "gauge", "part")
# Measurement Systems Analysis, 4th edition: tables III-B 7 and 8; by the other method figure III-B 16, which
# rounds averages to four digits before it goes on, so that its fourth digit may be one off.
ANOVA = ("anova", (0.199933, 0.226838, 0.302373, 1.042327), (18.42, 20.90, 27.86, 96.04))
RANGES = ("ranges", (0.20188, 0.22963, 0.30575, 1.10456), (17.62, 20.04, 26.68, 96.38))


@pytest.mark.parametrize(
    ("method", "sigmas", "percents", "total", "categories", "digits"),
    [(*ANOVA, 1.0853, 4.861, (5e-6, 0.005)), (*RANGES, 1.14610, 5.094, (5e-5, 0.01))],
)
def test_crossed_equals_aiag_example(method, sigmas, percents, total, categories, digits):
    spread = getattr(crossed(AIAG), method)
    ours = [getattr(spread, name) for name in PARTS]
    assert ours == pytest.approx(sigmas, abs=digits[0])
    assert [spread.percent(value) for value in ours] == pytest.approx(percents, abs=digits[1])
    assert spread.total == pytest.approx(total, abs=5e-5)
    assert spread.categories == pytest.approx(categories, abs=1e-3)
    assert crossed(AIAG).interaction_p == pytest.approx(0.974, abs=1e-3)


def test_type_one_bias_equals_aiag_example():
    # Chapter III-B, independent sample method: fifteen readings of a reference of 6.00.
    study = type_one([reading - 6.0 for reading in AIAG_BIAS], 1.0)
    assert study.bias == pytest.approx(0.0067, abs=5e-5)
    t = study.bias / (study.sigma / sqrt(len(AIAG_BIAS)))
    assert study.bias_p == pytest.approx(2 * stats.t.sf(abs(t), len(AIAG_BIAS) - 1), rel=1e-9)
    assert study.bias_p > 0.9


@given(st.floats(0.5, 30.0), st.floats(0.5, 30.0), st.floats(0.0, 1.0))
def test_beta_share_equals_scipy(a, b, x):
    assert beta_share(x, a, b) == pytest.approx(special.betainc(a, b, x), rel=1e-9, abs=1e-13)


@given(st.floats(0.0, 50.0), st.integers(1, 60), st.integers(1, 120))
def test_f_tail_and_t_tail_equal_scipy(statistic, above, below):
    ours = [f_tail(statistic, above, below), t_tail(statistic, below)]
    theirs = [stats.f.sf(statistic, above, below), 2 * stats.t.sf(statistic, below)]
    assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-12)


def test_crossed_variance_estimates_are_unbiased():
    rng = np.random.default_rng(4)
    drawn = {"repeatability": 0.3, "reproducibility": 0.5, "part": 2.0}
    squares = []
    for _ in range(400):
        parts, appraisers = rng.normal(0, 2.0, (10, 1, 1)), rng.normal(0, 0.5, (1, 3, 1))
        readings = parts + appraisers + rng.normal(0, 0.3, (10, 3, 3))
        spread = crossed(readings.tolist()).anova
        squares.append([getattr(spread, name) ** 2 for name in drawn])
    means, errors = np.mean(squares, 0), np.std(squares, 0) / sqrt(len(squares))
    assert np.all(np.abs(means - np.square(list(drawn.values()))) < 4 * errors + 1e-3)


@given(st.floats(0.1, 10.0), st.floats(-5.0, 5.0))
def test_crossed_scales_with_the_unit_and_ignores_an_offset(scale, offset):
    ours = crossed([[[scale * x + offset for x in cell] for cell in row] for row in AIAG])
    assert ours.anova.gauge == pytest.approx(scale * crossed(AIAG).anova.gauge, rel=1e-6)
    assert ours.percent == pytest.approx(crossed(AIAG).percent, rel=1e-6)


PAIR = [1.0, 2.0]


@pytest.mark.parametrize(
    "readings",
    [[], [[PAIR] * 2], [[PAIR], [PAIR]], [[[1.0]] * 2] * 2, [[PAIR, [1.0]]] * 2],
)
def test_crossed_unbalanced_study_is_refused(readings):
    with pytest.raises(ValueError, match="crossed study"):
        crossed(readings)


SCATTERED = st.lists(st.floats(-1.0, 1.0), min_size=25, max_size=60)


@given(SCATTERED.filter(lambda values: stdev(values) > 1e-3))
def test_type_one_cgk_is_at_most_cg(deviations):
    study = type_one(deviations, 4.0)
    assert study.cgk <= study.cg
    assert study.capable == (study.cgk >= 1.33)


def test_type_one_too_few_or_equal_readings_give_none():
    assert type_one([0.1, 0.2] * 12, 1.0).capable is None
    assert type_one([0.1] * 25, 1.0).capable is None
    assert type_one([0.1], 1.0).sigma is None
