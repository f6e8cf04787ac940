"""The replay of a table conserves its parts, and agrees with the evaluation."""

from dataclasses import replace

import numpy as np

from planner.evaluation.evaluate import evaluate
from planner.job.model import Job
from planner.report.replay import replay
from planner.world import ContactWorld
from runtime.table import REJECT, Table

TRIALS = 1500


def conserve(table: Table, job: Job) -> int:
    """Checks that all nodes pass on the parts that reach them; returns the number of rejected parts."""
    replayed = replay(table, job, TRIALS, seed=3)
    assert len(replayed.visits[0].before) == TRIALS
    rejected = 0
    for node, visit in zip(table.nodes, replayed.visits, strict=True):
        assert len(visit.before) == len(visit.after) == len(visit.width_mm) == len(visit.branch)
        assert np.all(np.isfinite(visit.after))
        rejected += len(visit.through(REJECT))
        for number, branch in enumerate(node.branches):
            target = branch.target
            arrived = replayed.visits[target].before if target >= 0 else replayed.leaves[~target]
            assert np.array_equal(arrived, visit.through(number))
        left = sum(len(visit.through(number)) for number in range(len(node.branches)))
        assert left + len(visit.through(REJECT)) == len(visit.before)
    assert sum(map(len, replayed.leaves)) + rejected == TRIALS
    return rejected


def test_replay_children_hold_the_parts_of_their_parent_minus_rejects(
    table: Table, job: Job
) -> None:
    conserve(table, job)


def test_replay_rejected_parts_reach_no_leaf(table: Table, job: Job) -> None:
    root = table.nodes[0]
    narrow = [branch._replace(high_um=branch.expected_um) for branch in root.branches]
    nodes = root._replace(branches=tuple(narrow)), *table.nodes[1:]
    assert conserve(replace(table, nodes=nodes), job) > 50


def test_replay_reaches_leaves_as_often_as_evaluate(table: Table, job: Job) -> None:
    ours = np.array([len(poses) for poses in replay(table, job, TRIALS, seed=5).leaves])
    leaf = evaluate(table, job, ContactWorld(job, 6), TRIALS, 7).leaf
    theirs = np.bincount(leaf[leaf >= 0], minlength=len(table.leaves))
    share = (ours + theirs + 1) / (2 * TRIALS)
    assert np.all(np.abs(ours - theirs) < 5.0 * np.sqrt(2 * TRIALS * share))
