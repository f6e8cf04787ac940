"""The partition of encoder counts against an exhaustive search, and what the planner relies on."""

import itertools

import numpy as np
import pytest

from planner.belief.observation import (
    HOLE,
    LEAST_CUT,
    Encoder,
    Partition,
    Resolution,
    cut,
    resolution_of,
)
from runtime.table import PROFILES, GripperProfile

RESOLUTION = Resolution()
SPREAD = 0.54
"""Spread that is little enough, over the distance that tells two clusters apart."""


def partition(counts, resolution=RESOLUTION):
    """Clusters of readings by k-means."""
    apart = resolution.apart
    weight = np.bincount(counts, minlength=256)
    bounds, _ = cut(weight, resolution.free, SPREAD * apart, 0.0, apart, HOLE * apart)
    inside = [(counts >= low) & (counts < high) for high, low in itertools.pairwise(bounds)]
    return Partition.of([counts[rows] for rows in inside])


def scatter(counts, label):
    parts = [counts[label == k] for k in np.unique(label)]
    return sum(float(((part - part.mean()) ** 2).sum()) for part in parts)


def least_scatter(counts, k):
    values = np.unique(counts)
    best = np.inf
    for places in itertools.combinations(range(1, len(values)), k - 1):
        label = np.searchsorted(np.array(places), np.searchsorted(values, counts), side="right")
        best = min(best, scatter(counts, label))
    return best


@pytest.mark.parametrize("seed", range(8))
def test_k_means_finds_the_least_scatter_of_the_least_k_that_is_little_enough(seed):
    rng = np.random.default_rng(seed)
    weight = np.zeros(60, np.int64)
    weight[rng.choice(60, size=9, replace=False)] = rng.integers(1, 50, size=9)
    counts = np.repeat(np.arange(60), weight)
    within = rng.uniform(0.005, 0.5)
    bounds, merged = cut(weight, free=60, spread=0.0, within=within, apart=0.0, hole=np.inf)
    label = np.searchsorted(-bounds, -counts)
    k = len(bounds) - 1
    assert len(merged) == 0
    assert scatter(counts, label) == pytest.approx(least_scatter(counts, k))
    enough = within * scatter(counts, np.zeros(len(counts), int))
    assert least_scatter(counts, k) <= enough
    assert k == 1 or least_scatter(counts, k - 1) > enough


def test_what_the_encoder_cannot_tell_apart_is_merged_and_said_so():
    # Two sharp widths two bins apart, a third far off: to explain nearly all the variance takes all three.
    weight = np.zeros(256, np.int64)
    weight[[150, 152, 180]] = 1000
    bounds, merged = cut(weight, free=228, spread=0.0, within=1e-4, apart=3.0, hole=6.0)
    assert len(bounds) == 3
    assert merged.tolist() == [[150.0, 152.0]]
    apart, none = cut(weight, free=228, spread=0.0, within=1e-4, apart=1.5, hole=6.0)
    assert len(apart) == 4
    assert len(none) == 0


def test_an_empty_hand_is_a_cluster_of_its_own_however_near_or_rare():
    counts = np.repeat([225, 227, 223, 222], [3, 2, 500, 400])
    clusters = partition(counts)
    assert clusters.low[0] == RESOLUTION.free == 225
    assert clusters.size[0] == 5
    assert clusters.high[1] < RESOLUTION.free


def test_a_hole_cuts_a_cluster_where_both_sides_hold_enough():
    hole = int(HOLE * RESOLUTION.apart)
    many, few = 100_000, LEAST_CUT
    rare = partition(np.repeat([150, 150 + hole], [many, few]))
    assert rare.mean.tolist() == [150.0 + hole, 150.0]
    assert len(partition(np.repeat([150, 150 + hole], [many, few - 1])).mean) == 1
    assert len(partition(np.repeat([150, 150 + hole - 1], [many, few])).mean) == 1
    both = partition(np.repeat([150 - hole, 150, 150 + hole], [few, many, few]))
    assert both.size.tolist() == [few, many, few]


def test_readings_of_widths_that_far_apart_are_hardly_ever_mistaken():
    encoder = Encoder(85.0, 227, 0.3)
    resolution = resolution_of(encoder)
    rng = np.random.default_rng(1)
    wide = np.full(100_000, 30.0)
    narrow = wide - resolution.apart * encoder.mm_per_step
    middle = 0.5 * (encoder.read(wide, rng).mean() + encoder.read(narrow, rng).mean())
    mistaken = np.mean(encoder.read(wide, rng) > middle) + np.mean(
        encoder.read(narrow, rng) < middle
    )
    assert mistaken < 0.02
    assert np.mean(encoder.read(np.zeros(100_000), rng) < resolution.free) < 0.003


def encoder(noise=0.0):
    return Encoder(opening_mm=85.0, steps=227, noise_mm=noise)


def test_resolution_is_the_published_one():
    assert encoder().mm_per_step == pytest.approx(0.374, abs=5e-4)


def test_reading_and_width_agree_to_half_a_step():
    widths = np.linspace(0, 85, 2001)
    counts = encoder().read(widths, np.random.default_rng(0))
    assert np.all(np.abs(encoder().width_mm(counts) - widths) <= 0.5 * encoder().mm_per_step + 1e-9)
    assert counts[0] == 227
    assert counts[-1] == 0


def test_noise_has_its_standard_deviation_and_stops_are_hard():
    rng = np.random.default_rng(1)
    counts = encoder(noise=1.0).read(np.full(20_000, 40.0), rng)
    scatter = counts.std() * encoder().mm_per_step
    assert scatter == pytest.approx(np.hypot(1.0, encoder().mm_per_step / np.sqrt(12)), rel=0.03)
    ends = encoder(noise=1.0).read(np.array([0.0] * 500 + [85.0] * 500), rng)
    assert ends.max() == 227
    assert ends.min() == 0


def test_width_um_of_a_reading_is_that_of_the_grippers_grid():
    for profile in (PROFILES["robotiq-2f-85"], GripperProfile("f", 50_000, 7.0, 5, (1, 2), (1, 2))):
        fine = Encoder(profile.stroke_um / 1e3, profile.steps, 0.0)
        steps = np.arange(profile.steps + 1)
        read = [profile.reading_um(profile.steps - int(step)) for step in steps]
        assert fine.width_um(steps).tolist() == read
