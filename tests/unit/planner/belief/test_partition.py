"""Partitions of readings: the cheapest of all cuts, with the properties that the planner relies on."""

import itertools
from statistics import NormalDist

import numpy as np
import pytest
from counting import label_of

from planner.belief.metric import Metric
from planner.belief.observation import Partition, Resolution
from planner.belief.partition import Rule
from planner.belief.partition import partition as labels_of
from planner.belief.stopping import StoppingRule

FREE = 228
PLACES = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [-20.0, 0.0, 0.0], [0.0, 20.0, 0.0]])
"""Poses so far apart that no goal holds two of them."""
MOST = 48
"""So few particles that each of them is a candidate for a mode."""


def rule(modes=1, confidence=0.95):
    return Rule(Metric(3.0, 10.0, 2, modes=modes), StoppingRule(confidence), Resolution(free=FREE))


def partition(poses, readings, how):
    label = labels_of(poses, readings, how)
    return Partition.of([readings[label == k] for k in range(label.max() + 1)])


def to_go(hits, size, estimate):
    """Slow reference version of what the stopping rule `estimate` predicts for one interval of readings.

    The interval has `size` particles, of which `hits` are in modes.

    Returns:
        The cost-to-go of each particle, and the probability that the true share of hits is below the rule's
        confidence.
    """
    total = size + estimate.inside + estimate.outside
    share = (hits + estimate.inside) / total
    short = NormalDist(share, (share * (1.0 - share) / total) ** 0.5).cdf(estimate.confidence)
    further = 2.0 - hits / size
    return short * further + (1.0 - short) * min(estimate.failure * (1.0 - share), further), short


def cost(place, counts, starts, how):
    """Slow reference version: the cost of one partition of the readings, by the rule `how`.

    The particles have the places `place` and the readings `counts`. Each interval of the partition begins at
    one of the readings `starts`, which rise.
    """
    total = 0.0
    for low, end in itertools.pairwise([*starts, FREE]):
        inside = (counts >= low) & (counts < end)
        read, held = counts[inside], place[inside]
        if not len(read):
            continue
        order = held[np.argsort(read, kind="stable")]
        names = list(dict.fromkeys(order.tolist()))
        often = [int(np.sum(held == name)) for name in names]
        left, short = to_go(sum(sorted(often)[-how.metric.modes :]), len(read), how.stopping)
        near = (
            (counts >= read.min() - how.reach)
            & (counts <= read.max() + how.reach)
            & ~inside
            & (counts < FREE)
        )
        wrong = near
        if how.metric.modes == 1:
            wrong = near & (place != names[int(np.argmax(often))])
        total += how.branch + len(read) * left + how.astray * short * np.sum(near)
        total += (1.0 - short) * how.stopping.failure * how.doubt * np.sum(wrong)
    return total


def readings(rng, values):
    """Places and readings of random particles, with `values` different readings.

    Most particles that have the same reading lie at the same place.
    """
    counts = np.sort(rng.choice(np.arange(150, 150 + 3 * values), size=values, replace=False))
    main = rng.integers(0, len(PLACES), values)
    size = rng.multinomial(MOST - values, np.full(values, 1.0 / values)) + 1
    read = np.repeat(counts, size)
    place = np.repeat(main, size)
    strange = rng.random(MOST) < rng.uniform(0.0, 0.5)
    place[strange] = rng.integers(0, len(PLACES), int(strange.sum()))
    mixed = rng.permutation(MOST)
    return place[mixed], read[mixed]


@pytest.mark.parametrize("seed", range(12))
def test_partition_costs_the_least_of_all_cuts(seed):
    rng = np.random.default_rng(seed)
    how = rule(modes=1 + seed % 2, confidence=rng.uniform(0.6, 0.99))
    place, counts = readings(rng, int(rng.integers(1, 9)))
    clusters = partition(PLACES[place], counts, how)
    values = np.unique(counts)
    choices = [
        [values[0], *later]
        for k in range(len(values))
        for later in itertools.combinations(values[1:], k)
    ]
    assert len(choices) == 2 ** (len(values) - 1)
    least = min(cost(place, counts, starts, how) for starts in choices)
    assert cost(place, counts, np.sort(clusters.low), how) == pytest.approx(least)


@pytest.mark.parametrize("seed", range(6))
def test_partition_intervals_hold_each_reading_once(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 600))
    counts = np.clip(np.rint(rng.choice([60, 90, 100, 180, 229], n) + rng.normal(0, 3, n)), 3, 233)
    counts = counts.astype(np.int64)
    poses = np.column_stack(
        [counts // 20 * 10.0 + rng.normal(0, 1, n), rng.normal(0, 1, n), np.zeros(n)]
    )
    clusters = partition(poses, counts, rule())
    assert clusters.size.sum() == n
    assert np.all(clusters.low <= clusters.high)
    assert np.all(clusters.low[:-1] > clusters.high[1:])
    for k, size in enumerate(clusters.size):
        members = counts[label_of(clusters, counts) == k]
        assert (members.min(), members.max(), len(members)) == (
            clusters.low[k],
            clusters.high[k],
            size,
        )
        assert members.mean() == pytest.approx(clusters.mean[k])
    empty = counts[counts >= FREE]
    if len(empty):
        assert (clusters.low[0], clusters.size[0]) == (empty.min(), len(empty))
    assert np.sum(clusters.high >= FREE) == (len(empty) > 0)


def test_partition_rare_empty_hand_is_a_separate_interval():
    counts = np.repeat([228, 230, 226, 225], [3, 2, 500, 400])
    clusters = partition(np.zeros((905, 3)), counts, rule())
    assert (clusters.low[0], clusters.high[0], clusters.size[0]) == (228, 230, 5)
    assert clusters.high[1] == 226


def test_partition_noisy_readings_of_one_pose_are_one_interval():
    counts = np.rint(150 + 1.5 * np.random.default_rng(0).standard_normal(2000)).astype(np.int64)
    assert len(partition(np.zeros((2000, 3)), counts, rule()).mean) == 1
    assert len(partition(np.zeros((1, 3)), np.array([77]), rule()).mean) == 1
