"""The likelihood against its slow twin, and bandwidths recovered from data of known scatter."""

import math

import numpy as np
import pytest
from problems import LONG_JAWS, random_poses, rectangle
from reference import kcde_twin

from planner.learned.bandwidth import (
    H1_MOST,
    H2_MOST,
    LEAST_SCATTER_MM,
    NEAR,
    OUTLIERS,
    choose,
    local_scatter,
    log_likelihood,
)
from planner.learned.kcde import Kcde, Rows

RHO = 10.0
JAWS = np.append(LONG_JAWS[:3], 1.0)
"""One finger moves, so that no roll-out counts twice."""
IDENTITY = np.vstack([np.eye(3), np.zeros(3)])


def scattered(n, seed, sigma):
    """Parts that stay where they are but for a normal scatter sigma (3,) [mm]; the first 300 aside."""
    rng = np.random.default_rng(seed)
    start = random_poses(rng, n, 8.0) * [1.0, 1.0, 0.4]
    final = start + sigma * rng.standard_normal((n, 3)) / [1.0, 1.0, RHO]
    rows = Rows(start[300:], final[300:], np.full(n - 300, 30.0))
    slope = np.repeat(IDENTITY[None], n - 300, axis=0)
    model = Kcde.fit(rows, rectangle(), JAWS, RHO, 1, 1.0, 0.0, slope)
    return model, start[:300], final[:300]


def test_the_likelihood_is_that_of_the_mixture():
    rng = np.random.default_rng(0)
    start, final = random_poses(rng, 400, 8.0), random_poses(rng, 400, 4.0)
    model = Kcde.fit(Rows(start, final, np.zeros(400)), rectangle(), JAWS, RHO, 2)
    asked, ended = random_poses(rng, 50, 8.0), random_poses(rng, 50, 4.0)
    scatter = rng.uniform(0.2, 2.0, (400, 3))
    h1, h2 = np.array([0.4, 1.5]), np.array([0.5, 1.0, 3.0])
    table = log_likelihood(model, scatter, asked, ended, h1, h2)
    volume = np.ptp(start[:, :2], axis=0).prod() * RHO * math.pi
    for i, a in enumerate(h1):
        for j, b in enumerate(h2):
            density = kcde_twin.density(asked, ended, model.initial, model.end[:, :3], RHO, 2, a, b * scatter)
            mean = np.log((1 - OUTLIERS) * density + OUTLIERS / volume).mean()
            assert table[i, j] == pytest.approx(mean, abs=1e-6)


def test_known_scatter_is_recovered():
    model, start, final = scattered(4000, 1, np.full(3, 0.2))
    found = choose(model, start, final, local=False, h1_most_mm=4.0, h2_most=2.0)
    weight = kcde_twin.weights(start, model.initial, RHO, 1, found.best.h1_mm)
    neighbours = np.median(1.0 / (weight**2).sum(axis=1))
    silverman = 0.2 * (4.0 / 5.0 / neighbours) ** (1.0 / 7.0)  # best for normal data in three dimensions
    assert silverman / 1.3 < found.best.h2 < silverman * 1.3
    assert found.best.h1_mm > 1.0
    assert found.best == max(found.curve, key=lambda tried: tried.mean_log)


def test_local_bandwidths_pay_where_scatter_differs():
    sigma = np.array([0.5, 0.01, 0.01])
    model, start, final = scattered(4000, 2, sigma)
    limits = {"h1_most_mm": 1.0, "h2_most": 4.0}
    one = choose(model, start, final, local=False, **limits)
    local = choose(model, start, final, local=True, **limits)
    assert local.best.mean_log > one.best.mean_log + 1.0
    applied = local.applied_to(model)
    middle = np.median(applied.scatter, axis=0)
    assert applied.h1_mm == local.best.h1_mm
    assert middle[0] > 10 * middle[1]


def test_limits_are_kept_and_paper_bandwidths_survive_them():
    model, start, final = scattered(2000, 3, np.full(3, 0.2))
    found = choose(model, start, final)
    assert all(t.h1_mm <= H1_MOST * model.grid.spacing_mm * (1 + 1e-9) for t in found.curve)
    assert all(t.h2 <= H2_MOST * (1 + 1e-9) for t in found.curve)
    assert np.array_equal(found.applied_to(model).scatter, found.best.h2 * local_scatter(model))


def test_scatter_is_that_of_the_most_alike_of_the_nearest():
    model, _, _ = scattered(700, 4, np.array([0.3, 0.0, 0.1]))
    ours = local_scatter(model)
    gaps = kcde_twin.offsets(model.initial, model.initial, RHO, 1)
    nearest = np.argsort((gaps**2).sum(axis=-1), axis=1)[:, 1 : NEAR + 1]
    for j in range(0, 400, 7):
        moved = model.initial[nearest[j]] - model.initial[j]
        ends = model.end[nearest[j], :3] - model.end[j, :3] - moved
        ends[:, 2] *= RHO
        alike = ends[np.argsort((ends**2).sum(axis=1))[:3]]
        assert ours[j] == pytest.approx(np.maximum(np.sqrt((alike**2).mean(axis=0)), LEAST_SCATTER_MM))


def test_few_roll_outs_have_a_scatter_too():
    rows = Rows(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros(1))
    model = Kcde.fit(rows, rectangle(), JAWS, RHO, 1)
    assert np.all(local_scatter(model) == LEAST_SCATTER_MM)
