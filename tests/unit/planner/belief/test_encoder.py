"""The linear encoder of the gripper."""

import numpy as np
import pytest

from planner.belief.observation import Encoder


def encoder(noise=0.0):
    return Encoder(opening_mm=85.0, steps=227, noise_mm=noise)


def test_resolution_is_the_published_one():
    assert encoder().mm_per_count == pytest.approx(0.374, abs=5e-4)


def test_reading_and_width_agree_to_half_a_count():
    widths = np.linspace(0, 85, 2001)
    counts = encoder().read(widths, np.random.default_rng(0))
    assert np.all(
        np.abs(encoder().width_mm(counts) - widths) <= 0.5 * encoder().mm_per_count + 1e-9
    )
    assert counts[0] == 230
    assert counts[-1] == 3


def test_noise_has_its_standard_deviation_and_stops_are_hard():
    rng = np.random.default_rng(1)
    counts = encoder(noise=1.0).read(np.full(20_000, 40.0), rng)
    scatter = counts.std() * encoder().mm_per_count
    assert scatter == pytest.approx(np.hypot(1.0, encoder().mm_per_count / np.sqrt(12)), rel=0.03)
    ends = encoder(noise=1.0).read(np.array([0.0] * 500 + [85.0] * 500), rng)
    assert ends.max() == 230
    assert ends.min() == 3
