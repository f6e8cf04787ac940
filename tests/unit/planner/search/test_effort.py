"""The settings of passes and nodes are in order."""

import pytest

from planner.search.effort import EFFORTS, EXPLORING, FRUGAL, LEAVES, PASSES


def test_passes_in_order_never_lose_particles_and_end_with_all():
    particles = [stage.particles for stage in PASSES]
    assert particles == sorted(particles)
    assert particles[-1] == LEAVES.particles == 1


def test_passes_together_are_all_the_work():
    assert sum(stage.work for stage in PASSES) == pytest.approx(1.0)


def test_first_pass_alone_is_frugal_and_another_explores():
    assert [stage.frugal for stage in PASSES] == [True, False, False, False, False]
    assert EXPLORING in PASSES[1:]


def test_efforts_reach_every_probability_and_grow_with_it():
    least = [effort.least for effort in EFFORTS]
    assert least == sorted(least, reverse=True)
    assert least[-1] == 0.0
    for field in ("actions", "scattered", "particles"):
        values = [getattr(effort, field) for effort in EFFORTS]
        assert values == sorted(values, reverse=True)
    assert EFFORTS[-1:] == FRUGAL
