"""Passes and efforts: what the search presupposes of their rows."""

import itertools

import pytest

from planner.search.effort import EFFORTS, PASSES, REPAIR
from planner.search.proposals import SCATTERED


def test_passes_end_with_all_particles_and_no_pass_has_fewer_than_the_one_before():
    particles = [each.particles for each in PASSES]
    assert particles == sorted(particles)
    assert particles[-1] == REPAIR.particles == 1
    assert sum(each.work for each in PASSES) == pytest.approx(1.0)
    assert REPAIR.least == 0.0  # leaves that trials refute are expanded, however rare


def test_passes_that_explore_continue_a_tree_of_as_many_particles():
    pairs = list(itertools.pairwise(PASSES))
    assert any(each.explores for each in PASSES)
    assert not PASSES[0].explores
    for before, each in pairs:
        assert not each.explores or before == each._replace(work=before.work, explores=False)


def test_passes_differ_so_that_each_draws_particles_of_its_own():
    """`Search.begin` seeds a pass with the place of the first one that is equal to it."""
    assert [PASSES.index(each) for each in PASSES] == list(range(len(PASSES)))


def test_efforts_fall_with_the_probability_and_one_fits_every_node():
    assert EFFORTS[-1].least == 0.0
    for more, less in itertools.pairwise(EFFORTS):
        assert more.least > less.least
        assert all(a >= b for a, b in zip(more[1:], less[1:], strict=True))
    assert all(0 < each.actions <= each.scattered <= SCATTERED for each in EFFORTS)
