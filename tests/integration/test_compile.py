"""The whole planner on the paper's rectangle, and the committed table."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from planner import job as job_file
from planner.compile import compile_job
from planner.errors import NoPlanError
from planner.evaluate import REJECTED, evaluate
from planner.search.expand import breadth_first
from planner.world import make
from runtime.table import Calibration, count_map, dumps, load, loads

TREES = Path(__file__).parents[2] / "trees"


@pytest.fixture(scope="module")
def job():
    return job_file.load(TREES / "rectangle" / "job.toml")


@pytest.fixture(scope="module")
def plan(job):
    return compile_job(job, workers=2, trials=4000)


def test_same_seed_gives_the_same_bytes_on_one_worker_and_two(job, plan):
    again = compile_job(job, workers=1, trials=4000)
    assert dumps(again.table) == dumps(plan.table)


def test_another_seed_gives_another_table(job, plan):
    other = compile_job(dataclasses.replace(job, seed=job.seed + 1), workers=2, trials=4000)
    assert dumps(other.table) != dumps(plan.table)


def test_beliefs_are_conserved_down_the_tree(plan):
    for node in breadth_first(plan.root):
        if node.children:
            assert sum(child.share for child in node.children) == pytest.approx(node.share)
    leaves = [node for node in breadth_first(plan.root) if not node.children]
    assert sum(leaf.share for leaf in leaves) == pytest.approx(1.0)


def test_tree_and_table_have_the_same_nodes_in_the_same_order(plan):
    nodes = [node for node in breadth_first(plan.root) if node.children]
    assert len(nodes) == len(plan.table.nodes)
    for node, row in zip(nodes, plan.table.nodes, strict=True):
        assert len(node.children) == len(row.branches)
        assert row.squeeze.x_um == pytest.approx(1e3 * node.placement[0], abs=50)
    leaves = [node for node in breadth_first(plan.root) if not node.children]
    for leaf, row in zip(leaves, plan.table.leaves, strict=True):
        assert row.x_um == pytest.approx(1e3 * leaf.mode.pose[0], abs=1000)


def test_every_reading_seen_in_planning_leads_to_its_own_branch(plan):
    calibration = Calibration.linear(plan.table.gripper)
    nodes = [node for node in breadth_first(plan.root) if node.children]
    agree = total = 0
    for node, row in zip(nodes, plan.table.nodes, strict=True):
        outcome = count_map(row, calibration)
        for k in range(len(node.children)):
            for count in range(node.clusters.low[k], node.clusters.high[k] + 1):
                agree += outcome[count] == k
                total += 1
                assert outcome[count] >= 0
    assert agree >= 0.95 * total


def test_committed_table_is_what_its_job_compiles_to_in_kind(job):
    table = load(TREES / "rectangle" / "rectangle.msgpack")
    assert table.job_digest == job.digest()
    assert job_file.from_canonical(table.job) == job


def test_committed_table_finds_the_part(job):
    table = load(TREES / "rectangle" / "rectangle.msgpack")
    evaluation = evaluate(table, job, make(job, seed=11), 4000, seed=12)
    figures = evaluation.summary()
    assert figures["success_rate"] >= 0.985
    assert figures["mean_squeezes"] <= 3.5
    assert figures["crashes"] == 0
    assert figures["success_ci95"][0] <= figures["success_rate"] <= figures["success_ci95"][1]


class BlindWorld:
    """Squeezes nothing: every width is one that no branch holds."""

    def squeeze(self, pose_hand):
        return pose_hand, 60.0, "jammed"


def test_a_strange_part_is_rejected_and_never_given_a_pose(job, plan):
    evaluation = evaluate(plan.table, job, BlindWorld(), 50, seed=1)
    assert np.all(evaluation.leaf == REJECTED)
    assert evaluation.summary()["reject_rate"] == 1.0
    assert evaluation.summary()["success_rate"] == 0.0
    assert np.all(evaluation.squeezes == 1)


def test_a_table_without_its_job_still_runs(plan):
    stripped = dataclasses.replace(plan.table, job=None)
    assert loads(dumps(stripped)).nodes == plan.table.nodes


L_SHAPE = "outline_mm = [[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]]"


def l_job(proposals):
    """An L without symmetry, searched for with few particles."""
    text = (TREES / "rectangle" / "job.toml").read_text(encoding="utf-8")
    new = {"outline_mm": L_SHAPE, "proposals": f'proposals = "{proposals}"'}
    lines = [new.get(line.split(" ")[0], line) for line in text.splitlines()]
    search = '[search]\nmodel = "simulation"\nparticles = 2000\nsearch_particles = 200\n'
    return job_file.parse("\n".join(lines).replace("radius_mm = 12.75", "radius_mm = 10") + "\n" + search)


def test_off_centre_squeezes_tell_an_l_from_its_half_turn():
    figures = compile_job(l_job("belief"), workers=2, trials=3000).evaluation.summary()
    assert figures["success_rate"] >= 0.97
    assert figures["mean_squeezes"] <= 4.5
    assert figures["crashes"] == 0


def test_a_budget_leaves_a_valid_tree_that_knows_what_it_does_not_know(job):
    with pytest.raises(NoPlanError):
        compile_job(job, workers=2, trials=500, budget_s=1e-9)
    plan = compile_job(job, workers=2, trials=2000, budget_s=60.0)
    assert loads(dumps(plan.table)) == plan.table
