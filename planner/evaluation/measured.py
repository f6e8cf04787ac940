"""Puts the figures of an evaluation into its table, in place of the planner's own estimates.

Branches that lead only to leaves that no trial reached are removed: their widths become REJECT.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from planner.arrays import Array
from planner.belief.particles import Belief
from planner.evaluation.judge import main_poses, metric_of_table
from planner.evaluation.outcome import ERROR_SHARES, Evaluation
from planner.job.model import Job
from planner.lower import covariance_of, pose_of
from runtime import table as tables

LEAST_VISITS = 200  # least number of parts at a node for measured shares of its branches


def with_figures(
    table: tables.Table, evaluation: Evaluation, job: Job
) -> tuple[tables.Table, Evaluation]:
    """Puts measured figures into the leaves and branches of a table.

    A leaf becomes unresolved if its trials refute it in a binomial test against the goal's confidence; the
    level of the test holds for all leaves together. Its alternatives are then the other main poses of the
    parts that ended there. A leaf that no part reached keeps its figures, and the test uses these. A leaf
    also becomes unresolved if the jaws could not hold a part at the leaf's pose: the few trials of such a
    leaf are squeezes that the simulator gave up.

    Returns:
        The new table, and the evaluation with the new table, so that `resolved` agrees with its leaves.
    """
    leaves = [_leaf(leaf, index, evaluation, job) for index, leaf in enumerate(table.leaves)]
    table = replace(table, nodes=_measured(table, evaluation), leaves=tuple(leaves))
    for index in {index for index, _ in tables.not_held(table, tables.job_of(table) or {})}:
        leaves[index] = leaves[index]._replace(resolved=False)
    table = replace(table, leaves=tuple(leaves))
    return table, replace(evaluation, table=table)


def predicting(table: tables.Table, evaluation: Evaluation) -> tables.Table:
    """Returns the table with the success rate, squeezes and errors of an evaluation as its prediction."""
    figures = evaluation.summary()
    median_um, p95_um = _errors_um(evaluation.error_mm[evaluation.resolved])
    predicted = tables.Prediction(
        success_ppm=round(tables.PPM * figures["success_rate"]),
        trials=figures["trials"],
        mean_squeezes_ppm=round(tables.PPM * figures["mean_squeezes"]),
        reject_ppm=round(tables.PPM * figures["reject_rate"]),
        error_median_um=median_um,
        error_p95_um=p95_um,
    )
    return replace(table, predicted=predicted)


def leading(table: tables.Table, reached: Collection[int]) -> list[list[int]]:
    """For each node, the indices of the branches that lead to a leaf in `reached`."""
    kept: list[list[int]] = [[] for _ in table.nodes]
    for index in reversed(range(len(table.nodes))):  # children come after their parents
        for number, (*_, target) in enumerate(table.nodes[index].branches):
            if kept[target] if target >= 0 else ~target in reached:
                kept[index].append(number)
    return kept


def without_untried(table: tables.Table, kept: list[list[int]]) -> tables.Table:
    """Returns the table with only the branches `kept` at each node, and without the subtrees of all others.

    Widths of removed branches become REJECT; neighbouring branches do not take them over.
    """
    order, nodes, leaves = [0], [], []
    for index in order:  # grows while it is walked
        branches = []
        for branch in _branches(table.nodes[index], kept[index], table.gripper):
            if branch.target >= 0:
                order.append(branch.target)
                branches.append(branch._replace(target=len(order) - 1))
            else:
                leaves.append(table.leaves[~branch.target])
                branches.append(branch._replace(target=-len(leaves)))
        nodes.append(table.nodes[index]._replace(branches=tuple(branches)))
    return replace(table, nodes=tuple(nodes), leaves=tuple(leaves))


def _leaf(leaf: tables.Leaf, index: int, evaluation: Evaluation, job: Job) -> tables.Leaf:
    """Returns the leaf number `index` with the figures of its trials, unresolved if they refute it."""
    here = evaluation.leaf == index
    trials, hits = int(here.sum()), int((here & evaluation.within).sum())
    # A leaf without trials is tested again: its figures were tested at the level of more leaves.
    seen = (hits, trials) if trials else (tables.successes_of(leaf), leaf.trials)
    refuted = tables.refuted(*seen, job.goal.confidence, len(evaluation.table.leaves))
    leaf = leaf._replace(resolved=leaf.resolved and not refuted)
    if trials == 0:
        return leaf
    median_um, p95_um = _errors_um(evaluation.error_mm[here])
    leaf = leaf._replace(
        success_ppm=round(tables.PPM * hits / trials),
        trials=trials,
        error_median_um=median_um,
        error_p95_um=p95_um,
    )
    if trials > 2:
        result = Belief.of(evaluation.poses[here], traits=evaluation.traits[here])
        leaf = leaf._replace(covariance=covariance_of(result, leaf, job))
    return leaf if leaf.resolved else _open(leaf, evaluation, evaluation.states[here])


def _errors_um(error_mm: Array) -> tuple[int, int]:
    """Median and 95th percentile [um] of errors [mm]; 0 if there are none."""
    median, high = np.quantile(error_mm, ERROR_SHARES) if len(error_mm) else (0.0, 0.0)
    return round(1e3 * float(median)), round(1e3 * float(high))


def _open(leaf: tables.Leaf, evaluation: Evaluation, states: Array) -> tables.Leaf:
    """Returns an unresolved leaf with alternatives: the main poses of its parts, except the predicted one.

    `states` are the final poses of the parts.
    """
    metric = metric_of_table(evaluation.table)
    predicted = np.array([*tables.predicted_pose(leaf), leaf.hypothesis])
    alternatives = [
        tables.LeafPose(*pose_of(mode.pose), mode.hypothesis[0])
        for mode in main_poses(states, metric)
        if not metric.reached(mode.state, predicted)
    ]
    return leaf._replace(alternatives=tuple(alternatives))


def _measured(table: tables.Table, evaluation: Evaluation) -> tuple[tables.Node, ...]:
    """Returns the nodes of a table, with the measured shares of their branches.

    A node that fewer than `LEAST_VISITS` parts reached keeps its shares.
    """
    nodes = []
    for index, node in enumerate(table.nodes):
        taken = evaluation.branch[evaluation.path == index]
        visits = np.bincount(taken[taken >= 0], minlength=len(node.branches))
        total = int(visits.sum())
        if total >= LEAST_VISITS:
            branches = [
                branch._replace(probability_ppm=round(tables.PPM * int(count) / total))
                for branch, count in zip(node.branches, visits, strict=True)
            ]
            node = node._replace(branches=tuple(branches))
        nodes.append(node)
    return tuple(nodes)


def _branches(
    node: tables.Node, numbers: list[int], gripper: tables.GripperSpec
) -> list[tables.Branch]:
    """Returns the branches `numbers` of a node.

    If the node has other branches, each returned branch is narrowed to the widths that select it in the whole
    node, and the shares are scaled to add up to 1.
    """
    if len(numbers) == len(node.branches):
        return list(node.branches)
    meant = [each for part in tables.decision_map(node, gripper) for each in part.intervals()]
    total = sum(node.branches[number].probability_ppm + 1 for number in numbers)
    kept = []
    for number in numbers:
        branch = node.branches[number]
        low = min(start for start, _, mine in meant if mine == number)
        high = max(end for _, end, mine in meant if mine == number)
        expected = min(max(branch.expected_um, low), high)
        share = round(tables.PPM * (branch.probability_ppm + 1) / total)
        kept.append(tables.Branch(low, expected, high, share, branch.target))
    return kept
