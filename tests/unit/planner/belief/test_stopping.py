"""When a belief counts as located, when trials refute a leaf, and what the cost-to-go of a leaf is."""

import math

import numpy as np
import pytest
from scipy.stats import binom

from planner.belief.stopping import LEAST_EVIDENCE, LEAST_TRIALS, StoppingRule
from runtime.table import refuted

RULE = StoppingRule(0.99)


@pytest.mark.parametrize("trials", [200, 1000, 20_000])
def test_refuted_leaf_well_above_the_goal_is_rare(trials):
    """A leaf that holds 99.8 % of its parts is refuted in less than 5 % of cases."""
    hits = np.arange(trials + 1)
    again = np.array([RULE.refuted(int(k), trials) for k in hits])
    assert binom.pmf(hits, trials, 0.998)[again].sum() < 0.05


@pytest.mark.parametrize("trials", [1000, 20_000])
def test_refuted_leaf_below_the_goal_is_likely(trials):
    """A leaf that holds 98 % of its parts is refuted in more than 95 % of cases."""
    hits = np.arange(trials + 1)
    again = np.array([RULE.refuted(int(k), trials) for k in hits])
    assert binom.pmf(hits, trials, 0.98)[again].sum() > 0.95


def test_refuted_follows_the_exact_test_where_trials_are_few():
    for trials in (1, 5, 50, LEAST_TRIALS - 1):
        for hits in range(trials + 1):
            assert RULE.refuted(hits, trials) == refuted(hits, trials, 0.99)


def test_holds_allows_a_miss_by_chance_only_with_evidence():
    few, many = LEAST_EVIDENCE - 1, LEAST_EVIDENCE
    assert not RULE.holds(0.989, few)
    assert RULE.holds(0.989, many)
    assert not RULE.holds(0.95, many)
    assert RULE.holds(0.99, 1)


def test_cost_to_go_matches_the_beta_distribution_it_approximates():
    hits, size = 985.0, 1000
    total = size + RULE.inside + RULE.outside
    share = (hits + RULE.inside) / total
    deviation = math.sqrt(share * (1.0 - share) / total)
    miss = 0.5 * math.erfc((share - 0.99) / deviation / math.sqrt(2.0))
    further = 2.0 - hits / size
    expected = miss * further + (1.0 - miss) * min(100.0 * (1.0 - share), further)
    assert RULE.cost_to_go(hits, size) == pytest.approx(expected)
