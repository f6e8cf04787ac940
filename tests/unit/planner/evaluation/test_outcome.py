"""Each trial of an evaluation ends in exactly one way."""

from dataclasses import replace

import numpy as np
import pytest
from sample_tables import small_table

from planner.evaluation.evaluate import evaluate
from planner.evaluation.outcome import CRASHED, NOWHERE, REJECTED, Evaluation
from planner.mechanics.traits import as_planned
from planner.world import ContactWorlds


def test_resolved_trial_without_leaf_is_false():
    table = small_table()
    for leaves in (table.leaves[:1], table.leaves):
        few = replace(table, leaves=leaves)
        ends = np.array([CRASHED, REJECTED, NOWHERE, 0])
        poses, taken = np.zeros((4, 3)), np.full((4, 1), NOWHERE)
        run = Evaluation(few, ends, np.zeros(4), poses, poses, as_planned(4), taken, taken, taken)
        assert list(run.resolved) == [False, False, False, True]


def test_evaluation_each_trial_ends_in_exactly_one_way(job, table):
    noisy = job.replaced(gripper={"noise_mm": 0.5})
    world = ContactWorlds.of_job(noisy, 1)
    evaluation = evaluate(table, noisy, world, 1500, seed=2)
    ways = [evaluation.success, evaluation.wrong, evaluation.rejected, evaluation.unresolved]
    assert np.all(np.sum(ways, axis=0) == 1)
    figures = evaluation.summary()
    rates = ("success_rate", "wrong_rate", "reject_rate", "unresolved_rate")
    assert sum(figures[rate] for rate in rates) == pytest.approx(1.0)
