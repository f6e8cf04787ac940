"""Disturbances: errors of the cell besides its mechanics."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from planner.belief.doubts import hypotheses_of, traits_of
from planner.evaluation.disturbance import NONE, WITH_DOUBTS, Disturbance
from planner.evaluation.evaluate import evaluate
from planner.frames import to_hand
from planner.world import ContactWorlds


def test_evaluate_constant_arm_bias_is_a_change_of_frame(job, table):
    """The hand misses all parts at a bias of 120 mm; each final pose is the initial one minus the bias."""
    worlds, bias = ContactWorlds.of_job(job, 5), Disturbance(bias_mm=(120.0, 0.0))
    displaced = evaluate(table, job, worlds, 200, 3, disturbance=bias)
    assert displaced.poses == pytest.approx(displaced.initial - bias.bias)
    near = evaluate(table, job, worlds, 1000, 3, disturbance=Disturbance(bias_mm=(1.5, 0.0)))
    assert near.success.mean() > 0.99


def test_placed_hand_is_off_by_the_bias_in_the_world_and_across_in_its_frame(job):
    rng = np.random.default_rng(1)
    hands, traits = rng.uniform(-2.0, 2.0, (20, 3)), NONE.traits(job, 20, rng)
    np.testing.assert_array_equal(NONE.placed(hands, traits, rng), hands)
    off = Disturbance(bias_mm=(3.0, -1.0), bias_deg=2.0, across_mm=0.7)
    there = off.placed(hands, off.traits(job, 20, rng), rng)
    moved = hands + np.array([3.0, -1.0, np.radians(2.0)])
    seen = [to_hand(hand, place) for hand, place in zip(there, moved, strict=True)]
    np.testing.assert_allclose(seen, np.tile([0.0, 0.7, 0.0], (20, 1)), atol=1e-12)


def test_placed_hand_scatters_anew_in_every_squeeze_as_stated(job):
    rng, n = np.random.default_rng(2), 20_000
    noisy, traits = Disturbance(placement_mm=0.5, placement_deg=1.0), NONE.traits(job, n, rng)
    first, second = (noisy.placed(np.zeros((n, 3)), traits, rng) for _ in range(2))
    spread = np.array([0.5, 0.5, np.radians(1.0)])
    np.testing.assert_allclose(first.std(axis=0), spread, rtol=0.03)
    np.testing.assert_allclose((first - second).std(axis=0), np.sqrt(2.0) * spread, rtol=0.03)


@pytest.mark.parametrize(
    ("cell", "contact", "draw"),
    [
        (WITH_DOUBTS, False, traits_of),
        (NONE, True, partial(traits_of, with_doubts=False)),
        (NONE, False, hypotheses_of),
    ],
)
def test_traits_are_the_latent_parameters_plus_the_stated_errors(job, cell, contact, draw):
    job = job.replaced(doubt={"middle_mm": [0.2, 0.6]})
    expected = draw(job, 300, np.random.default_rng(3))
    expected["encoder_mm"] += 0.4
    expected["across_mm"] -= 0.3
    off = replace(cell, encoder_offset_mm=0.4, across_mm=-0.3)
    traits = off.traits(job, 300, np.random.default_rng(3), contact=contact)
    for name in expected.dtype.names:
        np.testing.assert_allclose(traits[name], expected[name])
