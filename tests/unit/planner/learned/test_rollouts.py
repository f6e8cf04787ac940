"""Roll-outs are reproducible; a small set is the start of a large one; parts out of reach do not move."""

from dataclasses import replace

import numpy as np
import problems
import pytest

from planner.learned import rollouts
from planner.learned.rollouts import roll_outs
from planner.mechanics import quartic_fit
from planner.mechanics.squeeze import UNTOUCHED
from planner.part.outline import radius_of_gyration
from planner.part.pressure import Pressure, support

SMALL = {"radius_mm": 10.0, "count": 3000}


@pytest.fixture(scope="module")
def part():
    return problems.simulator(problems.rectangle())


@pytest.fixture(scope="module")
def small(part):
    return roll_outs(part, **SMALL)


def same(a, b):
    return all(x.tobytes() == y.tobytes() for x, y in zip(a, b, strict=True))


def rows_of(result, ring):
    """The roll-outs whose part starts in a ring about the hand: one row each, in their order."""
    distance = np.hypot(result.initial[:, 0], result.initial[:, 1])
    inside = (distance >= 5.0 * ring) & (distance < 5.0 * (ring + 1))
    columns = [result.initial, result.final, result.width_mm[:, None], result.status[:, None]]
    return np.hstack(columns)[inside]


@pytest.mark.parametrize("outline", problems.OUTLINES.values(), ids=problems.OUTLINES)
def test_within_reach_parts_beyond_it_stay_untouched(outline):
    part = problems.simulator(outline())
    radius = 1.1 * rollouts.farthest(part.outline, problems.JAWS)
    poses = problems.random_poses(np.random.default_rng(1), 4000, radius)
    far = poses[~rollouts.within_reach(part.outline, problems.JAWS, poses)]
    rolled = part.roll_out(far, part.sample(len(far), np.random.default_rng(2)))
    assert len(far) > 100
    assert np.all(rolled.status == UNTOUCHED)
    assert np.array_equal(rolled.poses, far)


def test_roll_outs_fewer_are_a_prefix_of_more_in_each_ring(part, small):
    more = roll_outs(part, SMALL["radius_mm"], 3 * SMALL["count"])
    for ring in range(2):
        few = rows_of(small, ring)
        assert np.array_equal(rows_of(more, ring)[: len(few)], few)
        assert len(rows_of(more, ring)) == pytest.approx(3 * len(few), abs=3)


def test_roll_outs_other_workers_is_identical(part, small):
    assert same(roll_outs(replace(part, workers=3), **SMALL), small)


def test_content_of_changes_with_mechanics_but_not_with_workers(part):
    points, weights = support(Pressure("boundary", 100), problems.rectangle())
    quartic = quartic_fit.fit_pressure(points, weights, radius_of_gyration(problems.rectangle()))
    others = [
        replace(part, outline=part.outline * 1.001),
        replace(part, surface=problems.boundary_surface(part.outline * [1.0, 0.9])),
        replace(part, surface=replace(part.surface, rho_mm=11.0)),
        replace(part, surface=quartic),
        replace(part, surface=replace(quartic, certificate=2.0 * quartic.certificate)),
        replace(part, jaws=part.jaws._replace(length_mm=30.0)),
        replace(part, friction=(0.4, 0.7)),
        replace(part, wishart_dof=99),
        replace(part, release=(0.1, 0.1, 0.0)),
        replace(part, step_mm=0.3),
    ]
    names = {rollouts.content_of(each) for each in [part, *others]}
    assert len(names) == 1 + len(others)
    assert rollouts.content_of(replace(part, workers=7)) == rollouts.content_of(part)
