"""Readings of the encoder: their resolution, noise and stops, and the widths that they stand for."""

import numpy as np
import pytest

from planner.belief.observation import Encoder, resolution_of
from runtime.table import PROFILES, GripperProfile


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
