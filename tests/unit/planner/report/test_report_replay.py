"""Parts sent through a table are neither lost nor made, and come out where the evaluation says."""

from dataclasses import replace

import numpy as np

from planner.evaluation.evaluate import evaluate
from planner.job.model import Job
from planner.report.replay import replay
from planner.world import ContactWorld
from runtime.table import REJECT, Table

TRIALS = 1500


def conserve(table: Table, job: Job) -> int:
    """Checks every node's account; returns how many parts were rejected."""
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


def test_children_hold_what_their_parent_had_minus_the_rejected(table: Table, job: Job) -> None:
    conserve(table, job)


def test_rejected_parts_go_nowhere(table: Table, job: Job) -> None:
    root = table.nodes[0]
    narrow = [branch._replace(high_um=branch.expected_um) for branch in root.branches]
    nodes = root._replace(branches=tuple(narrow)), *table.nodes[1:]
    assert conserve(replace(table, nodes=nodes), job) > 50


def test_leaves_are_reached_as_often_as_in_the_evaluation(table: Table, job: Job) -> None:
    ours = np.array([len(poses) for poses in replay(table, job, TRIALS, seed=5).leaves])
    leaf = evaluate(table, job, ContactWorld(job, 6), TRIALS, 7).leaf
    theirs = np.bincount(leaf[leaf >= 0], minlength=len(table.leaves))
    share = (ours + theirs + 1) / (2 * TRIALS)
    assert np.all(np.abs(ours - theirs) < 5.0 * np.sqrt(2 * TRIALS * share))
