"""The tables of passes and efforts have the properties on which the search relies."""

import itertools

import pytest

from planner.search.effort import EFFORTS, PASSES, REPAIR
from planner.search.proposals import SCATTERED


def test_passes_particles_never_fall_and_end_with_all():
    particles = [each.particles for each in PASSES]
    assert particles == sorted(particles)
    assert particles[-1] == REPAIR.particles == 1
    assert sum(each.work for each in PASSES) == pytest.approx(1.0)
    assert REPAIR.least == 0.0  # leaves that trials refute are expanded, however rare


def test_passes_exploring_pass_equals_the_one_before_but_for_work():
    pairs = list(itertools.pairwise(PASSES))
    assert any(each.explores for each in PASSES)
    assert not PASSES[0].explores
    for before, each in pairs:
        assert not each.explores or before == each._replace(work=before.work, explores=False)


def test_passes_are_pairwise_different():
    """`Search.begin` seeds a pass with its index in `PASSES`: equal passes would draw equal particles."""
    assert [PASSES.index(each) for each in PASSES] == list(range(len(PASSES)))


def test_efforts_fall_with_probability_and_cover_all_nodes():
    assert EFFORTS[-1].least == 0.0
    for more, less in itertools.pairwise(EFFORTS):
        assert more.least > less.least
        assert all(a >= b for a, b in zip(more[1:], less[1:], strict=True))
    assert all(0 < each.actions <= each.scattered <= SCATTERED for each in EFFORTS)
