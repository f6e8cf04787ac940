"""What a squeeze makes of a belief."""

import numpy as np

from planner.belief.observation import Partition
from planner.belief.particles import Belief
from planner.belief.transition import Outcomes
from planner.mechanics.traits import as_planned


def test_a_branch_that_holds_a_pose_is_cut_where_nothing_was_read():
    reading = np.array([40, 41, 60, 61, 80, 120, 140])
    belief = Belief(np.zeros((7, 3)), as_planned(7), reading)
    outcomes = Outcomes(Partition.of([reading[5:], reading[:5]]), [belief[5:], belief[:5]], 30.0)
    assert outcomes.without_gaps(np.array([True, True]), 20) is outcomes
    cut = outcomes.without_gaps(np.array([False, True]), 10)
    assert [set(piece.reading) for piece in cut.beliefs] == [{120, 140}, {80}, {60, 61}, {40, 41}]
    assert cut.clusters.low.tolist() == [120, 80, 60, 40]
    assert cut.clusters.high.tolist() == [140, 80, 61, 41]
    assert np.isclose(cut.probability.sum(), 1.0)
