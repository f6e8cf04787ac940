"""Lowering a tree to a table keeps the tree's shape, readings and poses."""

from dataclasses import replace

import numpy as np
import pytest
from hand_grown import grown, leaf, squeezed

from planner.belief.observation import encoder_of, resolution_of
from planner.belief.particles import Belief
from planner.belief.transition import Push
from planner.lower import covariance_of, interval_um, lower, pose_of
from planner.mechanics.traits import as_planned
from runtime.table import PPM, REJECT, decide, decision_map, dumps, loads, predicted_pose


def meaning(node, table, job, felt=True):
    """The number of the branch that a node's decision map gives for each count of the encoder."""
    decided, encoder = decision_map(node, table.gripper), encoder_of(job)
    widths = encoder.width_um(np.arange(encoder.steps + 1)).tolist()
    return np.array([decide(decided, width, felt) for width in widths])


@pytest.mark.parametrize("silent", [0, 2])
def test_lower_reading_leads_to_the_same_child_as_in_the_tree(job, silent):
    root = grown(silent)
    table = loads(dumps(lower(root, job)))
    waiting, ends = [(root, 0)], set()
    while waiting:
        node, target = waiting.pop()
        if target < 0:
            ends.add(~target)
            assert not node.children
            assert table.leaves[~target][:3] == pose_of(node.mode.pose)
            continue
        row = table.nodes[target]
        assert sum(branch.probability_ppm for branch in row.branches) == pytest.approx(PPM, abs=2)
        for k, (child, branch) in enumerate(zip(node.children, row.branches, strict=True)):
            assert set(meaning(row, table, job)[child.belief.reading]) == {k}
            assert branch.probability_ppm / PPM == pytest.approx(child.share / node.share, abs=1e-6)
            waiting.append((child, branch.target))
    assert ends == set(range(len(table.leaves)))
    assert table.limits.max_depth == silent + 2


@pytest.mark.parametrize("seed", range(4))
def test_lower_readings_beside_clusters_go_to_the_nearest_up_to_the_margin(job, seed):
    margin, rng = resolution_of(encoder_of(job)).margin, np.random.default_rng(seed)
    ends = 20 + np.cumsum(rng.integers(1, 3 * margin, 10))
    clusters = [np.arange(low, high + 1) for low, high in ends.reshape(-1, 2)[::-1]]
    root = leaf(np.zeros((1, 3)), np.array([-1]), 1.0, 0)
    squeezed(root, 0.0, [(np.zeros((len(each), 3)), each) for each in clusters])
    table = lower(root, job)
    for count, branch in enumerate(meaning(table.nodes[0], table, job)):
        away = np.array([np.abs(each - count).min() for each in clusters])
        assert (branch == REJECT) == (away.min() > margin)
        assert branch == REJECT or away[branch] == away.min()


def test_lower_thin_part_and_empty_hand_differ_by_the_flag(job):
    encoder = encoder_of(job)
    closed, root = encoder.steps, leaf(np.zeros((2, 3)), np.array([-1, -1]), 1.0, 0)
    thin = resolution_of(encoder).free - 1
    squeezed(root, 0.0, [(np.zeros((1, 3)), np.array([each])) for each in (closed, thin)])
    table = lower(root, job)
    felt, unfelt = (meaning(table.nodes[0], table, job, flag) for flag in (True, False))
    assert set(felt[thin:closed]) == {1}
    assert unfelt[closed] == 0


def test_interval_um_of_adjacent_readings_tiles_the_opening(job):
    encoder = encoder_of(job)
    rows = [interval_um(low, low + 2, encoder) for low in range(0, encoder.steps + 1, 3)]
    assert [low for low, _ in rows[:-1]] == [high for _, high in rows[1:]]
    assert (rows[-1][0], rows[0][1]) == (0, round(1e3 * encoder.opening_mm))


@pytest.mark.parametrize("turns", [-2, 0, 1])
def test_pose_of_pose_turned_by_full_turns_is_the_same(turns):
    pose = np.array([1.2344, -5.6786, 2.5])
    result = np.array(pose_of(pose + np.array([0.0, 0.0, 2.0 * np.pi * turns])))
    np.testing.assert_allclose(result / [1e3, 1e3, 1e6], pose, atol=0.5e-3)


def test_covariance_of_belief_is_its_second_moment_up_to_symmetry(job):
    rng, (*_, end) = np.random.default_rng(3), lower(grown(), job).leaves
    off = rng.multivariate_normal([0.2, 0.0, 0.0], np.diag([1.0, 4.0, 0.01]) + 0.05, 500)
    belief = Belief.of(off + predicted_pose(end))
    result = covariance_of(belief, end, job)
    xx, xy, yy, xt, yt, tt = result
    scaled = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
    moment = np.mean(off[:, :, None] * off[:, None], axis=0)
    units = np.outer([10.0, 10.0, 100.0], [10.0, 10.0, 100.0])
    np.testing.assert_allclose(scaled, moment * units, atol=0.51)
    turned = Belief.of(belief.poses[::-1] + np.array([0.0, 0.0, np.pi]))
    assert covariance_of(turned, end, job) == result
    others = as_planned(500)
    others["hypothesis"] = 1
    assert not any(covariance_of(replace(belief, traits=others), end, job))


def test_lower_leaf_counts_the_fresh_trials_and_no_older_particles(job):
    root = grown()
    end = root.children[0]
    end.fresh = 40
    end.belief.poses[30:, 0] += 50.0
    first = lower(root, job).leaves[0]
    assert (first.trials, first.success_ppm) == (40, 0.75 * PPM)


def test_lower_pushed_parts_keep_the_push_and_state_no_contact(job):
    root = grown()
    push = Push(np.array([-40.0, 5.0, 2.0 * np.pi + 0.5]), 30.0, 12.5)
    assert lower(root, job).nodes[0].contact_um
    root.best.squeeze = replace(root.squeeze, pushes=(push,))
    node = lower(root, job).nodes[0]
    assert node.pushes[0][:5] == (-40_000, 5_000, 500_000, 30_000, 12_500)
    assert node.contact_um is None
