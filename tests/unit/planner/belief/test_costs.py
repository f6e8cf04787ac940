"""Costs of actions: converted to seconds, they equal the times that the table's schedule states."""

import math

import numpy as np
import pytest

from planner.belief.costs import Closing, Costs, Hand
from runtime import table as tables


@pytest.fixture(scope="module")
def job(job):
    return job.replaced(goal={"minimise": "seconds"})


@pytest.fixture(scope="module")
def costs(job):
    return Costs(job)


def placement_of(node):
    squeeze = node.squeeze
    return np.array([squeeze.x_um / 1e3, squeeze.y_um / 1e3, squeeze.angle_urad / 1e6])


def test_costs_of_two_squeezes_equal_the_schedule(costs, table):
    schedule = tables.Schedule.of(table, tables.job_of(table))
    root, timing, timed = table.nodes[0], schedule.timing, 0
    for number, branch in enumerate(root.branches):
        if branch.target <= 0:
            continue
        width_mm, after = branch.expected_um / 1e3, table.nodes[branch.target]
        squeezed = [tables.Squeezed(0, width_mm, number), tables.Squeezed(branch.target, 30.0, 0)]
        phases = schedule.part(squeezed)
        low_mm = timing.regrasp_mm - timing.squeeze_mm
        expected_s = sum(each.total_s for each in phases)
        expected_s += timing.move_s(low_mm) - phases[-1].rise_s  # as if another squeeze followed
        jaws = [
            Closing(node.squeeze.opening_um / 1e3, node.contact_um and node.contact_um / 1e3, 30.0)
            for node in (root, after)
        ]
        first = costs.squeeze(None, placement_of(root), jaws[0]._replace(width_mm=width_mm))
        hand = Hand(placement_of(root), width_mm)
        second = costs.squeeze(hand, placement_of(after), jaws[1])
        assert (first + second) * costs.typical_s == pytest.approx(expected_s, rel=1e-6)
        timed += 1
    assert timed > 3


def test_short_way_turns_at_most_a_quarter_to_an_equal_squeeze(costs):
    hand = Hand(np.array([3.0, -2.0, 2.9]), 25.0)
    placements = np.random.default_rng(0).uniform(-7.0, 7.0, (50, 3))
    nearest = costs.short_way(hand, placements)
    np.testing.assert_array_equal(nearest[:, :2], placements[:, :2])
    np.testing.assert_allclose(np.sin(2 * nearest[:, 2]), np.sin(2 * placements[:, 2]), atol=1e-12)
    assert np.abs(nearest[:, 2] - 2.9).max() <= math.pi / 2 + 1e-12
    np.testing.assert_array_equal(costs.short_way(None, placements), placements)


@pytest.mark.parametrize(
    ("halfwidth_deg", "turn"), [(180.0, 0.0), (90.0, 1.2)], ids=["turned", "as planned"]
)
def test_back_turned_plan_costs_no_turn(job, halfwidth_deg, turn):
    costs = Costs(job.replaced(uncertainty={"orientation_halfwidth_deg": halfwidth_deg}))
    hand, home = Hand(np.array([4.0, -3.0, 1.2]), 25.0), np.zeros(3)
    assert costs.back(hand, home) * costs.typical_s == pytest.approx(costs.timing.move_s(5.0, turn))
