"""What a page tells of one node or leaf when it is chosen: plain numbers, short enough for thousands of them.

Poses are integers, hundredths of a mm and milliradians; widths are um, as in the table.
"""

from __future__ import annotations

from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from planner.arrays import Array, IntArray
from planner.belief.particles import subsample
from planner.evaluation.statistics import wilson_interval
from planner.report.replay import Replay, Visit
from runtime.table import PPM, REJECT, Calibration, Leaf, Node, Table, by_count, decision_map

MOST = 60
"""Most outlines of one belief."""
BUDGET = 30_000
"""Outlines of all beliefs together: at some 15 bytes each, half a MB."""


class Run(NamedTuple):
    """Neighbouring encoder counts with one meaning: `branch` is an index or `REJECT`."""

    first: int
    last: int
    branch: int


def node_details(table: Table, beliefs: Replay) -> list[dict[str, Any]]:
    """One object a node: its squeeze, branches, belief, and counts read in the replay."""
    most = _most(table)
    calibration = Calibration.linear(table.gripper)
    return [
        _node(node, visit, by_count(decision_map(node, calibration)), most)
        for node, visit in zip(table.nodes, beliefs.visits, strict=True)
    ]


def leaf_details(table: Table, beliefs: Replay) -> list[dict[str, Any]]:
    """One object a leaf: its pose, what its trials showed, where its parts lay."""
    most = _most(table)
    return [_leaf(leaf, poses, most) for leaf, poses in zip(table.leaves, beliefs.leaves, strict=True)]


def runs(outcome: tuple[int, ...]) -> list[Run]:
    """A node's map of counts in short: neighbours of one meaning together, from count 0 on."""
    found = []
    for branch, group in groupby(enumerate(outcome), key=lambda entry: entry[1]):
        counts = [count for count, _ in group]
        found.append(Run(counts[0], counts[-1], branch))
    return found


def _most(table: Table) -> int:
    return min(MOST, BUDGET // (len(table.nodes) + len(table.leaves)))


def _node(node: Node, visit: Visit, outcome: tuple[int, ...], most: int) -> dict[str, Any]:
    squeeze = node.squeeze
    return {
        "place": [squeeze.x_um, squeeze.y_um, squeeze.angle_urad],
        "opening": squeeze.opening_um,
        "speed": squeeze.speed_um_s,
        "force": squeeze.force_mn,
        "clearance": squeeze.clearance_um,
        "release": node.release,
        "visits": len(visit.before),
        "belief": _poses(visit.before, most),
        "branches": [
            [
                branch.low_um, branch.expected_um, branch.high_um, branch.probability_ppm, branch.target,
                int(np.sum(visit.branch == number)),
            ]
            for number, branch in enumerate(node.branches)
        ],
        "rejected": int(np.sum(visit.branch == REJECT)),
        "map": [list(run) for run in runs(outcome) if run.branch != REJECT],
        "seen": _histogram(visit.counts),
    }  # fmt: skip


def _leaf(leaf: Leaf, poses: Array, most: int) -> dict[str, Any]:
    success = round(leaf.success_ppm * leaf.trials / PPM)
    return {
        "pose": [leaf.x_um, leaf.y_um, leaf.theta_urad],
        "covariance": list(leaf.covariance),
        "success": leaf.success_ppm,
        "interval": [round(bound, 5) for bound in wilson_interval(success, leaf.trials)],
        "trials": leaf.trials,
        "resolved": leaf.resolved,
        "alternatives": [list(pose) for pose in leaf.alternatives],
        "visits": len(poses),
        "belief": _poses(poses, most),
    }


def _poses(poses: Array, most: int) -> list[list[int]]:
    if most == 0:
        return []
    scaled = np.rint(subsample(poses, most) * (100.0, 100.0, 1000.0))
    return [list(map(int, pose)) for pose in scaled]


def _histogram(counts: IntArray) -> list[list[int]]:
    """Pairs of a count and how many read it."""
    values, numbers = np.unique(counts, return_counts=True)
    return [[int(value), int(number)] for value, number in zip(values, numbers, strict=True)]
