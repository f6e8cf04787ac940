"""What a page tells of one node or leaf when it is chosen: plain numbers, short enough for thousands of them.

Poses are integers, hundredths of a mm and milliradians; widths are um, as in the table.
"""

from collections import Counter
from itertools import groupby
from typing import Any, cast

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.evaluation.statistics import wilson_interval
from planner.evaluation.trials import Step
from planner.report.replay import Replay
from runtime.table import PPM, REJECT, Calibration, Leaf, Node, Table, by_count, decision_map

MOST = 60  # most outlines of one belief
BUDGET = 30_000  # outlines of all beliefs together: at some 15 bytes each, half a MB


def node_details(table: Table, beliefs: Replay) -> list[dict[str, Any]]:
    """One object a node: its squeeze, branches, belief, and counts read in the replay."""
    most, calibration = _most(table), Calibration.linear(table.gripper)
    return [
        _node(node, visit, by_count(decision_map(node, calibration)), most)
        for node, visit in zip(table.nodes, beliefs.visits, strict=True)
    ]


def leaf_details(table: Table, beliefs: Replay) -> list[dict[str, Any]]:
    """One object a leaf: its pose, what its trials showed, where its parts lay."""
    most = _most(table)
    return [_leaf(leaf, poses, most) for leaf, poses in zip(table.leaves, beliefs.leaves, strict=True)]


def runs(outcome: tuple[int, ...]) -> list[tuple[int, int, int]]:
    """Neighbouring encoder counts of one meaning: the first, the last, and the branch's index or `REJECT`."""
    groups = (list(group) for _, group in groupby(range(len(outcome)), key=outcome.__getitem__))
    return [(counts[0], counts[-1], outcome[counts[0]]) for counts in groups]


def _most(table: Table) -> int:
    return min(MOST, BUDGET // (len(table.nodes) + len(table.leaves)))


def _node(node: Node, visit: Step, outcome: tuple[int, ...], most: int) -> dict[str, Any]:
    squeeze, taken = node.squeeze, Counter(visit.branch.tolist())
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
                taken[number],
            ]
            for number, branch in enumerate(node.branches)
        ],
        "rejected": taken[REJECT],
        "map": [run for run in runs(outcome) if run[2] != REJECT],
        "seen": sorted(Counter(visit.counts.tolist()).items()),
    }  # fmt: skip


def _leaf(leaf: Leaf, poses: Array, most: int) -> dict[str, Any]:
    success = round(leaf.success_ppm * leaf.trials / PPM)
    return {
        "pose": [leaf.x_um, leaf.y_um, leaf.theta_urad],
        "covariance": leaf.covariance,
        "success": leaf.success_ppm,
        "interval": [round(bound, 5) for bound in wilson_interval(success, leaf.trials)],
        "trials": leaf.trials,
        "resolved": leaf.resolved,
        "alternatives": leaf.alternatives,
        "visits": len(poses),
        "belief": _poses(poses, most),
    }


def _poses(poses: Array, most: int) -> list[list[int]]:
    scaled = np.rint(subsample(poses, most) * (100.0, 100.0, 1000.0))
    return cast(list[list[int]], scaled.astype(np.int64).tolist())
