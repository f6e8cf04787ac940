"""Readings of the encoder: their resolution, noise and end stops, and the widths that they stand for."""

import numpy as np
import pytest

from planner.belief.observation import Encoder, resolution_of
from runtime.table import PROFILES, GripperProfile


def encoder(noise=0.0):
    return Encoder(opening_mm=85.0, steps=227, noise_mm=noise)


def test_resolution_of_noisy_encoder_keeps_widths_distinct():
    noisy, rng = encoder(noise=0.3), np.random.default_rng(1)
    resolution = resolution_of(noisy)
    wide = np.full(100_000, 30.0)
    narrow = wide - resolution.apart * noisy.mm_per_step
    middle = 0.5 * (noisy.read(wide, rng).mean() + noisy.read(narrow, rng).mean())
    confused = np.mean(noisy.read(wide, rng) > middle) + np.mean(noisy.read(narrow, rng) < middle)
    assert confused < 0.02
    assert np.mean(noisy.read(np.zeros(100_000), rng) < resolution.free) < 0.003


def test_mm_per_step_equals_the_published_resolution():
    assert encoder().mm_per_step == pytest.approx(0.374, abs=5e-4)


def test_read_without_noise_is_within_half_a_step():
    widths = np.linspace(0, 85, 2001)
    counts = encoder().read(widths, np.random.default_rng(0))
    assert np.all(np.abs(encoder().width_mm(counts) - widths) <= 0.5 * encoder().mm_per_step + 1e-9)
    assert counts[0] == 227
    assert counts[-1] == 0


def test_read_noise_has_its_deviation_and_stays_within_the_stops():
    rng = np.random.default_rng(1)
    counts = encoder(noise=1.0).read(np.full(20_000, 40.0), rng)
    scatter = counts.std() * encoder().mm_per_step
    assert scatter == pytest.approx(np.hypot(1.0, encoder().mm_per_step / np.sqrt(12)), rel=0.03)
    ends = encoder(noise=1.0).read(np.array([0.0] * 500 + [85.0] * 500), rng)
    assert ends.max() == 227
    assert ends.min() == 0


def test_width_um_equals_reading_um_of_the_gripper():
    for profile in (PROFILES["robotiq-2f-85"], GripperProfile("f", 50_000, 7.0, 5, (1, 2), (1, 2))):
        fine = Encoder(profile.stroke_um / 1e3, profile.steps, 0.0)
        steps = np.arange(profile.steps + 1)
        read = [profile.reading_um(profile.steps - int(step)) for step in steps]
        assert fine.width_um(steps).tolist() == read
