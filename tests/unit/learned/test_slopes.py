"""Slopes of roll-outs: known ones, and what carrying outcomes over with them is worth."""

import math

import numpy as np
import pytest
from problems import JAWS, rectangle, simulator

from planner.learned.rollouts import SLOPE, Block, _drawn, code_version, roll_outs, slope_block, slopes
from planner.learned.slopes import few, slopes_of
from planner.mechanics.touch import TOUCHES, meet
from planner.scheduler import Threads


def test_a_flush_grasp_keeps_the_slide_and_forgets_the_rest():
    part = simulator(rectangle())
    poses = np.array([[2.0, 3.0, 0.02], [-4.0, -1.0, -0.03]])
    slope = slopes_of(part, poses, part.nominal(2, 0.5))
    assert slope[:, 0, 0] == pytest.approx(1.0, abs=1e-3)
    for row in (1, 2, 3):
        assert slope[:, row] == pytest.approx(0.0, abs=0.01)


def test_outcomes_carried_over_are_nearer_than_outcomes_as_they_are():
    part = simulator(rectangle())
    rng = np.random.default_rng(0)
    poses = rng.uniform([-10, -10, -math.pi], [10, 10, math.pi], (1500, 3))
    parameters = part.sample(1500, rng)
    rho = part.surface.rho_mm
    shift = 0.3 * rng.standard_normal((1500, 3)) / [1.0, 1.0, rho]
    here, there = part.roll_out(poses, parameters), part.roll_out(poses + shift, parameters)
    slope = slopes_of(part, poses, parameters)
    carried = here.poses + np.einsum("nij,nj->ni", slope[:, :3], shift)
    error = np.linalg.norm((there.poses - carried) * [1.0, 1.0, rho], axis=1)
    stayed = np.linalg.norm((there.poses - here.poses) * [1.0, 1.0, rho], axis=1)
    assert np.median(error) < 0.15 * np.median(stayed)
    assert np.quantile(error, 0.9) < np.quantile(stayed, 0.9)
    width = here.width_mm + np.einsum("nj,nj->n", slope[:, 3], shift)
    assert np.median(np.abs(there.width_mm - width)) <= np.median(np.abs(there.width_mm - here.width_mm))


def test_slopes_belong_to_their_roll_outs():
    part = simulator(rectangle())
    rolled = roll_outs(part, 12.0, 2500, scheduler=Threads(2))
    slope = slopes(part, 12.0, 2500, scheduler=Threads(1))
    assert slope.shape == (len(rolled.initial), 4, 3)
    _, initial, parameters = _drawn(part, code_version(), Block(0, 0))
    first = np.flatnonzero(meet(part.outline, JAWS, initial) == TOUCHES)[:50]
    expected = slopes_of(part, initial[first], few(parameters, first))
    assert np.array_equal(rolled.initial[first], initial[first])
    assert slope[first] == pytest.approx(expected, rel=1e-6)


def test_parts_that_are_not_touched_have_no_slope():
    part = simulator(rectangle())
    rows = np.frombuffer(slope_block(part, code_version(), Block(6, 0)), SLOPE)["slope"]
    _, initial, _ = _drawn(part, code_version(), Block(6, 0))
    touched = meet(part.outline, JAWS, initial) == TOUCHES
    assert np.any(touched)
    assert np.all(rows[~touched] == 0.0)
    assert np.mean(np.any(rows[touched] != 0.0, axis=(1, 2))) > 0.9
