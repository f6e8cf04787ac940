"""What no trial of the evaluation took is never claimed: its widths become REJECT."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from planner.belief.observation import Partition
from planner.evaluation.evaluate import Evaluation
from planner.search.expand import TreeNode, breadth_first
from runtime.table import COUNTS, PPM, Branch, Calibration, Node, Table, decision_map


def tried(table: Table, runs: Sequence[Evaluation]) -> list[list[int]]:
    """The branches of each node that trials took, and after which there was an outcome.

    Args:
        table: the table.
        runs: evaluations of this table.
    """
    took = [set[int]() for _ in table.nodes]
    for run in runs:
        passed = run.path >= 0
        for index, number in set(zip(run.path[passed].tolist(), run.branch[passed].tolist(), strict=True)):
            took[index].add(number)
    kept: list[list[int]] = [[] for _ in table.nodes]
    for index in reversed(range(len(table.nodes))):  # children come after their parents
        targets = enumerate(branch.target for branch in table.nodes[index].branches)
        kept[index] = [n for n, target in targets if n in took[index] and (target < 0 or kept[target])]
    return kept


def without_untried(table: Table, root: TreeNode, kept: list[list[int]]) -> Table:
    """Leaves out branches and all that follows them, in the table and in the tree that it was lowered from.

    Args:
        table: the table.
        root: of its tree; changed.
        kept: the numbers of the branches that stay at each node; some at the root.

    Returns:
        The table. The widths of what was left out are REJECT: the branches beside it get none.
    """
    for node, numbers in zip([node for node in breadth_first(root) if node.children], kept, strict=True):
        assert node.squeeze is not None
        node.children = [node.children[number] for number in numbers]
        node.squeeze = node.squeeze._replace(clusters=_clusters(node.squeeze.clusters, numbers))
    calibration = Calibration.linear(table.gripper)
    order, nodes, leaves = [0], [], []
    for index in order:  # grows while it is walked
        branches = []
        for branch in _branches(table.nodes[index], kept[index], calibration):
            if branch.target >= 0:
                order.append(branch.target)
                branches.append(branch._replace(target=len(order) - 1))
            else:
                leaves.append(table.leaves[~branch.target])
                branches.append(branch._replace(target=-len(leaves)))
        nodes.append(table.nodes[index]._replace(branches=tuple(branches)))
    return replace(table, nodes=tuple(nodes), leaves=tuple(leaves))


def _branches(node: Node, numbers: list[int], calibration: Calibration) -> list[Branch]:
    """The branches that stay; where one goes, the others keep to the widths that they were read at."""
    if len(numbers) == len(node.branches):
        return list(node.branches)
    decided = np.array(decision_map(node, calibration))
    total = sum(node.branches[number].probability_ppm + 1 for number in numbers)
    kept = []
    for number in numbers:
        branch = node.branches[number]
        widths = [calibration.widths_um[reading % COUNTS] for reading in np.flatnonzero(decided == number)]
        low, high = min(widths), max(widths)
        expected = min(max(branch.expected_um, low), high)
        share = round(PPM * (branch.probability_ppm + 1) / total)
        kept.append(Branch(low, expected, high, share, branch.target))
    return kept


def _clusters(clusters: Partition, numbers: list[int]) -> Partition:
    label = np.full(len(clusters.mean) + 1, -1)  # the last is what was no cluster before
    label[numbers] = np.arange(len(numbers))
    return clusters._replace(
        label=label[clusters.label],
        mean=clusters.mean[numbers],
        low=clusters.low[numbers],
        high=clusters.high[numbers],
        size=clusters.size[numbers],
    )
