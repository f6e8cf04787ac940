"""A table takes over the figures of its evaluation; leaves that these figures refute become unresolved."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest
from sample_tables import random_table

from planner.belief.metric import Mode
from planner.belief.observation import Partition
from planner.belief.particles import Belief
from planner.evaluation.evaluate import evaluate
from planner.evaluation.measured import (
    LEAST_VISITS,
    leading,
    predicting,
    with_figures,
    without_untried,
)
from planner.evaluation.outcome import REJECTED
from planner.search import tree as plans
from planner.world import ContactWorlds
from runtime.table import PPM, REJECT, Prediction, Table, decide, decision_map, dumps


def test_with_figures_leaf_out_of_reach_of_the_jaws_is_unresolved(table, job):
    """No trial refutes the leaf, but the jaws could not hold a part at its pose."""
    run = evaluate(table, job, ContactWorlds.of_job(job, 1), 50, 1)
    index = next(
        k for k in range(len(table.leaves)) if k not in run.leaf and table.leaves[k].resolved
    )
    leaf = table.leaves[index]
    elsewhere = leaf._replace(x_um=leaf.x_um + 15_000, y_um=leaf.y_um + 15_000)
    leaves = (*table.leaves[:index], elsewhere, *table.leaves[index + 1 :])
    sound, _ = with_figures(table, run, job)
    measured, _ = with_figures(replace(table, leaves=leaves), run, job)
    assert sound.leaves[index].resolved
    assert not measured.leaves[index].resolved


def tree_of(table: Table, target: int = 0) -> plans.Node:
    """A tree of the table's shape, without beliefs."""
    node = plans.Node(Belief.of(np.empty((0, 3))), 1.0, Mode(np.zeros(3), 1.0))
    if target >= 0:
        branches = table.nodes[target].branches
        size = np.ones(len(branches), np.int64)
        clusters = Partition(1.0 * size, size, size, size)
        children = [tree_of(table, branch.target) for branch in branches]
        node.actions = [plans.Action(plans.Squeeze(np.zeros(3), 85.0, 0.0, clusters), children)]
    return node


@pytest.mark.parametrize("seed", range(2))
def test_without_untried_rejects_pruned_widths_and_keeps_all_others(
    seed: int,
) -> None:
    table, random = random_table(seed, 12), Random(seed)
    reached = {n for n in range(len(table.leaves)) if random.random() < 0.5} | {0}
    kept = leading(table, reached)
    pruned, root = without_untried(table, kept), plans.pruned(tree_of(table), kept)
    # `dumps` validates the table; its prediction was that of all leaves.
    dumps(replace(pruned, predicted=Prediction(0, 0, 0)))
    waiting = [(0, 0, root)]
    while waiting:
        old, new, planned = waiting.pop()
        before, after = table.nodes[old], pruned.nodes[new]
        assert after.squeeze == before.squeeze
        clusters = planned.squeeze.clusters.mean
        assert len(planned.children) == len(clusters) == len(after.branches) == len(kept[old])
        maps = [decision_map(node, table.gripper) for node in (before, after)]
        read = [
            tuple(decide(decided, width, felt) for decided in maps)
            for width in range(0, 86_000, 157)
            for felt in (False, True)
        ]
        for was, now in read:
            assert now == (kept[old].index(was) if was in kept[old] else REJECT)
        for number, branch, child in zip(kept[old], after.branches, planned.children, strict=True):
            target = before.branches[number].target
            if branch.target >= 0:
                waiting.append((target, branch.target, child))
            else:
                assert pruned.leaves[~branch.target] == table.leaves[~target]


@pytest.fixture(scope="module")
def run(job, table):
    return evaluate(table, job, ContactWorlds.of_job(job, 1), 1000, 1)


def test_with_figures_permuted_parts_gives_the_same_shares_and_rates(job, table, run):
    measured, _ = with_figures(table, run, job)
    mixed = run.of_rows(np.random.default_rng(2).permutation(1000))
    assert with_figures(table, mixed, job)[0] == measured
    nodes = zip(table.nodes, measured.nodes, strict=True)
    for number, (before, after) in enumerate(nodes):
        taken = run.branch[run.path == number]
        if np.sum(taken >= 0) < LEAST_VISITS:
            assert after == before
            continue
        shares = [np.mean(taken[taken >= 0] == k) for k in range(len(after.branches))]
        assert [each.probability_ppm / PPM for each in after.branches] == pytest.approx(shares)
    assert measured.nodes != table.nodes
    for number, leaf in enumerate(measured.leaves):
        ended = run.leaf == number
        assert leaf.trials == (ended.sum() or table.leaves[number].trials)
        if ended.any():
            assert leaf.success_ppm / PPM == pytest.approx(run.within[ended].mean(), abs=1e-6)


def test_with_figures_refuted_leaf_is_open_and_names_where_its_parts_lie(job, table, run):
    """All parts that end at the most frequent leaf lie 9 mm beside its pose."""
    number = int(np.argmax(np.bincount(run.leaf[run.leaf >= 0])))
    aside = run.poses + np.where(run.leaf == number, 9.0, 0.0)[:, None] * [1.0, 0.0, 0.0]
    measured, _ = with_figures(table, replace(run, poses=aside), job)
    before, after = table.leaves[number], measured.leaves[number]
    assert (before.resolved, after.resolved) == (True, False)
    places = [abs(pose.x_um - before.x_um - 9_000) for pose in after.alternatives]
    assert min(places) < 3_000


def test_predicting_a_table_states_the_rates_of_its_evaluation(table, run):
    predicted = predicting(table, run).predicted
    resolved = np.array([leaf.resolved for leaf in table.leaves])[run.leaf] & (run.leaf >= 0)
    error_um = 1e3 * run.error_mm[resolved]
    rates = resolved & run.within, np.sum(run.path >= 0, axis=1), run.leaf == REJECTED
    stated = [predicted.success_ppm, predicted.mean_squeezes_ppm, predicted.reject_ppm]
    assert stated == pytest.approx([PPM * np.mean(rate) for rate in rates])
    assert predicted.error_median_um == pytest.approx(np.median(error_um), abs=1.0)
    assert predicted.error_p95_um == pytest.approx(np.quantile(error_um, 0.95), abs=1.0)
