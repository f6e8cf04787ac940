"""The sequential verdict: its bounds equal the planner's, it is rarely wrong, and few parts suffice."""

from itertools import pairwise

import numpy as np
import pytest
from acceptance_cells import FAILED, GOOD, UNSEEN, Tried, tried
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from planner.evaluation import ppm
from runtime.spc.charts import binomial_at_most
from runtime.spc.history import Part
from runtime.spc.study.acceptance import (
    ERROR,
    POWER,
    SequentialTest,
    Verdict,
    followed,
    parts_for,
    planned,
)

WRONG, REJECT = FAILED[:2]


@settings(max_examples=40)
@given(st.integers(1, 5000), st.floats(0.0, 1.0), st.sampled_from([0.5, 0.05, 0.01, 5e-5]))
def test_sequential_test_bounds_with_same_prior_equal_planner(parts, share, limit):
    failures = int(share * parts)
    ours = SequentialTest(limit).bounds(failures, failures, parts)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(ppm, "PRIOR", (0.5, 0.5 * (1.0 - limit) / limit))
        theirs = ppm.Bound.of(float(failures), parts)
    assert 1e6 * ours.low == pytest.approx(theirs.low, rel=1e-6, abs=1e-3)
    assert 1e6 * ours.high == pytest.approx(theirs.high, rel=1e-6, abs=1e-3)


@given(st.integers(0, 300), st.integers(0, 300), st.floats(0.001, 0.5))
def test_sequential_test_verdict_agrees_with_bounds(failures, good, limit):
    test, parts = SequentialTest(limit), failures + good
    bounds = test.bounds(failures, failures, parts)
    assert bounds.low <= bounds.share <= bounds.high or parts == 0
    if test.accepts(failures, parts):
        assert bounds.high <= limit * (1 + 1e-9)
    if test.refuses(failures, parts):
        assert bounds.low >= limit * (1 - 1e-9)


def test_sequential_test_evidence_at_true_share_has_mean_one():
    # Ville's inequality needs a mean of 1 over all outcomes of n parts.
    test, parts, share = SequentialTest(0.05), 40, 0.05
    weights = stats.binom.pmf(np.arange(parts + 1), parts, share)
    ratios = np.exp([test.evidence(k, parts, share) for k in range(parts + 1)])
    assert weights @ ratios == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("rate", [0.05, 0.02, 0.09])
def test_followed_first_verdict_is_rarely_wrong(rate):
    # A sample of tests/bench/bench_acceptance.py; at the limit itself either verdict counts as wrong.
    results = [tried(np.random.default_rng([seed, 7]), rate, 0.05, 600) for seed in range(60)]
    most = stats.binom.ppf(0.999, len(results), ERROR)
    assert sum(cell is Tried.WRONG for cell in results) <= most
    if rate != 0.05:
        assert sum(cell is Tried.RIGHT for cell in results) > 20


def test_followed_unknown_parts_count_against_either_verdict():
    accepted = list(followed([GOOD] * 2000, 0.01))[-1]
    assert accepted.verdict is Verdict.ACCEPTED
    hidden = list(followed([GOOD, UNSEEN] * 1000, 0.01))[-1]
    assert (hidden.verdict, hidden.unknown) == (Verdict.OPEN, 1000)
    assert hidden.bounds.high > 0.4
    assert hidden.bounds.low == 0.0
    refused = list(followed([WRONG, UNSEEN] * 100, 0.01))[-1]
    assert refused.verdict is Verdict.REFUSED


def test_followed_reject_is_failure_and_stopped_part_ignored():
    fault, stopped = Part(3, outcome="fault"), Part(4, outcome="stopped")
    undelivered = Part(5, outcome="fault", verdict="pass")  # the audit came before the delivery
    (*_, last) = followed([GOOD, REJECT, fault, stopped, WRONG, undelivered], 0.01)
    assert (last.parts, last.failed, last.unknown) == (5, 4, 0)


def test_followed_verdict_once_reached_stays():
    course = list(followed([GOOD] * 2000 + [WRONG] * 500, 0.01))
    decided = [now.decided_at for now in course if now.decided_at]
    assert course[-1].verdict is Verdict.ACCEPTED
    assert set(decided) == {course[-1].decided_at}
    assert all(after.parts == before.parts + 1 for before, after in pairwise(course))


def test_planned_parts_are_fewest_that_suffice():
    test, count = SequentialTest(0.01), planned(0.01, 0.002)
    assert test.accepts(0, count.least)
    assert not test.accepts(0, count.least - 1)
    assert count.least < count.likely < 5000
    rng = np.random.default_rng(3)
    done = 0
    for _ in range(60):
        parts = [WRONG if wrong else GOOD for wrong in rng.random(count.likely) < 0.002]
        done += list(followed(parts, 0.01))[-1].verdict is Verdict.ACCEPTED
    assert done >= stats.binom.ppf(0.001, 60, POWER)


def test_planned_limit_that_no_one_can_show_gives_none():
    assert planned(1e-9, 0.0) == (None, None)


@pytest.mark.parametrize("expected", [None, 0.01, 0.5])
def test_planned_unknown_or_too_high_failure_share_gives_none(expected):
    assert planned(0.01, expected).likely is None


@given(st.integers(0, 60), st.integers(1, 60), st.floats(0.0, 1.0))
def test_binomial_at_most_equals_scipy(most, trials, share):
    theirs = stats.binom.cdf(most, trials, share)
    assert binomial_at_most(most, trials, share) == pytest.approx(theirs, abs=1e-9)


def test_parts_for_is_fewest_with_required_probability():
    count = parts_for(25, 0.1)
    assert stats.binom.sf(24, count, 0.1) >= 0.95 > stats.binom.sf(24, count - 1, 0.1)


@pytest.mark.parametrize(
    ("parts", "answered"), [(9_000_000, True), (9_999_999, True), (10_100_000, False)]
)
def test_parts_for_answers_up_to_ten_million_parts(parts, answered):
    """If a kind has the share s, it is missing among n parts with probability (1 - s)^n, here 0.05."""
    share = -np.expm1(np.log(0.05) / parts)
    result = parts_for(1, share)
    assert result is None if not answered else abs(result - parts) <= 2
