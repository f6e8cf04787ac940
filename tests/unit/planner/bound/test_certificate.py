"""Certificates of tables cover the plan's placements, and bound its mean number of squeezes from below."""

import numpy as np
import pytest

from planner.bound.certificate import Covered, certify, squeezes_of
from planner.evaluation.trials import encoder_of_table, placement_of
from runtime.table import REJECT, decide, decision_map

pytestmark = pytest.mark.slow

ANGLES = 4


@pytest.fixture(scope="module")
def matches(job, table):
    return certify(job, table, parts=2000, workers=2)


def test_certify_lower_bound_lies_between_two_and_the_mean_of_the_plan(matches, table):
    assert 2.0 < matches.squeezes < matches.mean
    assert matches.squeezes == max(matches.leaves.squeezes, matches.overall.squeezes)
    for term in (matches.leaves, matches.overall):
        assert term.squeezes < term.estimate < matches.mean
    assert matches.success < table.predicted.success_ppm / 1e6


def test_certify_other_workers_is_identical(matches, job, table):
    assert certify(job, table, parts=2000, workers=1) == matches


def placements_of(job, table, dense=False):
    return Covered(job, table, squeezes_of(job, 2), dense)


def test_covered_contains_the_plan_and_turned_plans_once(job, table):
    alone = placements_of(job, table)
    assert len(alone.first) == 1  # the four angles are one up to a turn
    root, encoder = table.nodes[0], encoder_of_table(table)
    assert np.allclose(alone(())[0], placement_of(root.squeeze))
    decided = decision_map(root, table.gripper)
    for step, um in enumerate(encoder.width_um(np.arange(encoder.steps + 1)).tolist()):
        branch = decide(decided, um, felt=True)
        if branch != REJECT and (target := root.branches[branch].target) >= 0:
            after = alone((0, 2 * step + 1))
            assert np.array_equal(after[-1], placement_of(table.nodes[target].squeeze))
            assert len(after) == ANGLES + 1
    narrow = job.replaced(uncertainty={"orientation_halfwidth_deg": 30.0})
    assert len(placements_of(narrow, table).first) == ANGLES
    uneven = job.replaced(gripper={"upper_finger_share": 0.4})
    assert len(placements_of(uneven, table).first) == ANGLES  # half a turn is another squeeze
    dense = placements_of(job, table, dense=True)
    assert len(dense.first) == 2  # over the middle, and to one side of it
