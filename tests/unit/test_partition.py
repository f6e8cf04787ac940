"""The partition of encoder counts against an exhaustive search, and what the planner relies on."""

import itertools

import numpy as np
import pytest

from planner.models.partition import APART_COUNTS, SPREAD_COUNTS, _best_bounds, partition


def spread(values, weight, bounds):
    total = 0.0
    for a, b in itertools.pairwise(bounds):
        mean = np.average(values[a:b], weights=weight[a:b])
        total += float(weight[a:b] @ (values[a:b] - mean) ** 2)
    return total


@pytest.mark.parametrize("seed", range(20))
def test_dynamic_programming_finds_the_least_spread_of_its_k(seed):
    rng = np.random.default_rng(seed)
    values = np.sort(rng.choice(60, size=9, replace=False)).astype(float)
    weight = rng.integers(1, 50, size=9).astype(float)
    bounds = _best_bounds(values, weight)
    k = len(bounds) - 1
    every = ([0, *cut, 9] for cut in itertools.combinations(range(1, 9), k - 1))
    assert spread(values, weight, bounds) == pytest.approx(min(spread(values, weight, b) for b in every))


def test_clusters_cover_every_reading_once_in_order_of_rising_width():
    rng = np.random.default_rng(3)
    counts = np.concatenate([rng.integers(130, 152, 500), rng.integers(172, 176, 300), np.full(40, 230)])
    clusters = partition(counts)
    assert clusters.size.sum() == len(counts)
    assert np.all(np.diff(clusters.mean) <= -APART_COUNTS)
    for k in range(len(clusters.mean)):
        members = counts[clusters.label[counts] == k]
        assert members.min() == clusters.low[k]
        assert members.max() == clusters.high[k]
        assert len(members) == clusters.size[k]
        assert members.mean() == pytest.approx(clusters.mean[k])


def test_one_width_is_one_cluster_and_encoder_noise_does_not_split_it():
    rng = np.random.default_rng(0)
    noisy = np.rint(150 + 0.4 * rng.standard_normal(2000)).astype(np.int64)
    assert len(partition(noisy).mean) == 1
    assert len(partition(np.array([77])).mean) == 1


def test_two_distant_widths_are_two_clusters():
    clusters = partition(np.array([100] * 10 + [140] * 5))
    assert clusters.mean.tolist() == [140.0, 100.0]
    assert SPREAD_COUNTS > 0
