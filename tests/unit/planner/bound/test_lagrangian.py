"""Lower bounds from all parts, and from samples of parts, in worlds where all plans can be enumerated."""

import numpy as np
import pytest
from scipy import stats
from toy_world import METRIC, Toy, poses_of

from planner.belief.particles import Belief
from planner.bound.histories import Depths, Histories
from planner.bound.lagrangian import (
    least_cost,
    least_mean,
    leaves_term,
    overall_term,
    upper_tail,
    worth_trying,
)

CERTAINTY = 0.95
TOYS = range(4)
SUCCESSES = (1.0, 0.9, 0.8, 0.5)
HALVES = Toy([list(range(8))] * 3, [[s >> bit & 1 for s in range(8)] for bit in range(3)])
"""Eight poses, which three squeezes of one bit each distinguish; a prediction locates three neighbours."""


def toy(seed):
    return Toy.drawn(np.random.default_rng(seed), actions=2 + seed % 2, size=6, readings=2)


def histories_of(world, depth, deepest, states=None):
    parts = Belief.of(poses_of(np.arange(world.size) if states is None else states))
    rng = np.random.default_rng(0)
    return Histories(world.squeeze, parts, METRIC, world.placements, Depths(depth, deepest), rng)


def levels_of(world, depth, states=None):
    return histories_of(world, depth, depth, states).levels


def assert_no_plan_is_below(world, levels):
    for success in SUCCESSES:
        term = overall_term(levels, success, CERTAINTY)
        assert term.squeezes <= term.estimate + 1e-12
        assert term.estimate <= world.least(success, 4) + 1e-9
        for confidence in (0.99, 0.7, 0.5):
            best = world.least(success, 4, least_share=confidence)
            assert leaves_term(levels, confidence, success, CERTAINTY).estimate <= best + 1e-9


@pytest.mark.parametrize("depth", [1, 2, 3])
@pytest.mark.parametrize("seed", TOYS)
def test_lower_bounds_of_toy_world_are_below_all_plans(seed, depth):
    world = toy(seed)
    assert_no_plan_is_below(world, levels_of(world, depth))


@pytest.mark.parametrize("depth", [1, 2, 3])
@pytest.mark.parametrize("seed", TOYS)
def test_lower_bounds_at_full_success_equal_the_best_plan(seed, depth):
    world = toy(seed)
    best = world.least(1.0, depth, granted=True)
    assert overall_term(levels_of(world, depth), 1.0, CERTAINTY).estimate == pytest.approx(best)
    best = world.least(1.0, depth, granted=True, least_share=0.999)
    leaves = leaves_term(levels_of(world, depth), 0.999, 1.0, CERTAINTY).estimate
    assert leaves == pytest.approx(best, abs=0.02)


@pytest.mark.parametrize("price", [1.0, 3.0, 30.0])
@pytest.mark.parametrize("seed", TOYS)
def test_worth_trying_squeezes_reach_the_cost_of_all_squeezes(seed, price):
    some = histories_of(toy(seed), 1, 3)
    costs = [least_cost(some.levels, price, 1.0)]
    while waiting := [
        (level, chosen)
        for level in range(1, min(3, len(some.levels)))
        if len(chosen := worth_trying(some.levels, level, price, 1.0))
    ]:
        some.extend(*waiting[0])
        costs.append(least_cost(some.levels, price, 1.0))
    assert np.all(np.diff(costs) >= -1e-12)
    assert costs[-1] == pytest.approx(least_cost(levels_of(toy(seed), 3), price, 1.0))


@pytest.mark.parametrize("seed", TOYS)
def test_lower_bounds_after_random_extension_are_below_all_plans(seed):
    world, rng = toy(seed), np.random.default_rng(seed)
    result = histories_of(world, 1, 3)
    for level in (1, 2, 1):
        untried = untried_of(result.levels, level)
        result.extend(level, rng.permutation(untried)[: 1 + len(untried) // 2])
        assert_no_plan_is_below(world, result.levels)


def untried_of(levels, level):
    tried = levels[level + 1].owner if level + 1 < len(levels) else []
    return np.setdiff1d(np.arange(len(levels[level].size)), tried)


def test_overall_term_of_samples_rarely_exceeds_the_best_plan():
    world, rng, success = HALVES, np.random.default_rng(7), 0.9
    best = world.least(success, 4)
    results = []
    for _ in range(30):
        levels = levels_of(world, 2, rng.integers(world.size, size=300))
        results.append(overall_term(levels, success, CERTAINTY).squeezes)
    assert np.mean(np.array(results) > best) <= 1.0 - CERTAINTY
    large = levels_of(world, 2, rng.integers(world.size, size=10_000))
    many = overall_term(large, success, CERTAINTY)
    exact = overall_term(levels_of(world, 2), success, CERTAINTY).estimate
    assert 1.0 < np.mean(results) < many.squeezes < exact + 1e-9


@pytest.mark.parametrize("mean", [0.001, 0.01, 0.3, 0.9])
@pytest.mark.parametrize("n", [100, 20_000])
@pytest.mark.parametrize("error", [0.05, 0.001])
def test_upper_tail_and_least_mean_hold_for_the_binomial(mean, n, error):
    most = upper_tail(mean, n, error)
    assert stats.binom.sf(np.ceil(n * most) - 1, n, mean) <= error
    assert mean < most <= 1.0
    sample = np.ceil(n * mean) / n  # a mean below the least one would rarely reach the sample's
    least = least_mean(sample, n, error)
    assert stats.binom.sf(n * sample - 1, n, least) <= error * (1.0 + 1e-9)
    assert 0.0 <= least < sample
