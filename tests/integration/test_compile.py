"""The whole planner on the paper's rectangle, and the committed table."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from programs import JOB, TABLE
from refusals import refused_in_a_line

from planner.belief.observation import MARGIN_MM
from planner.compile import compile_job
from planner.errors import NoPlanError
from planner.evaluation.cases import standard_cases
from planner.evaluation.evaluate import evaluate, sweep
from planner.evaluation.outcome import REJECTED
from planner.frames import wrap
from planner.job import model as job_file
from planner.search.tree import breadth_first
from planner.world import ContactWorlds, make
from runtime.table import (
    HELD_UM,
    PROFILES,
    GripperSpec,
    decision_map,
    dumps,
    load,
    loads,
    predicted_pose,
    wilson_interval,
)

FEW = {"particles": 300, "max_depth": 3}
CERTAIN = {"doubt": {"chance": 0.0}, "part": {"tolerance_mm": 0.0}}
GRIPPER = GripperSpec.of(PROFILES["robotiq-2f-85"], 1, 1)
OPENING = range(GRIPPER.steps, -1, -1)
WIDTHS_UM = np.array([GRIPPER.profile.reading_um(step) for step in OPENING])
"""The width of each reading [um], by the steps of closing."""


def meaning(node):
    """The number of the branch that a node selects at each reading, whatever the object flag."""
    meant = decision_map(node, GRIPPER).either
    return np.array([meant.at(width) for width in WIDTHS_UM.tolist()])


def inner(plan):
    """The nodes of a plan's tree that have children, breadth first."""
    return [node for node in breadth_first(plan.root) if node.children]


def leaves(plan):
    return [node for node in breadth_first(plan.root) if not node.children]


@pytest.fixture(scope="module")
def job():
    """The rectangle without doubt about the cell."""
    return job_file.load(JOB).replaced(**CERTAIN)


@pytest.fixture(scope="module")
def plan(job):
    thin = job.replaced(search={"particles": 2000})
    return compile_job(thin, workers=2, trials=4000)


@pytest.mark.parametrize("pushes", ["none", "belief"])
def test_compile_job_bytes_depend_on_seed_and_not_on_workers(job, pushes):
    """With pushes, the rectangle may lie farther out than the jaws open, so that the plan has to push it."""
    where = {"radius_mm": 12.0, "orientation_halfwidth_deg": 8.0}
    few = {"particles": 200, "max_depth": 2}
    quick = job.replaced(search=few, uncertainty=where, friction={"doubt": 0.0})
    if pushes == "belief":
        actions = {"pushes": pushes, "proposals": pushes}
        quick = quick.replaced(gripper={"opening_mm": 50.0}, actions=actions)
    one, two = (compile_job(quick, workers, trials=300).table for workers in (1, 2))
    assert dumps(one) == dumps(two)
    assert bool(one.nodes[0].pushes) == (pushes == "belief")
    if pushes == "none":
        other = dataclasses.replace(quick, seed=quick.seed + 1)
        assert dumps(compile_job(other, workers=2, trials=300).table) != dumps(one)


def test_compile_job_tree_conserves_belief_and_leaves_were_tried(plan):
    for node in breadth_first(plan.root):
        if node.children:
            assert sum(child.share for child in node.children) <= node.share + 1e-9
    # Branches that no trial took are cut off.
    untried = 2.0 * plan.untried / plan.table.predicted.trials
    assert sum(leaf.share for leaf in leaves(plan)) == pytest.approx(1.0, abs=1e-3 + untried)
    assert all(leaf.trials > 0 for leaf in plan.table.leaves)
    assert plan.untried < 0.5 * sum(len(node.branches) for node in plan.table.nodes)


def test_compile_job_table_has_nodes_of_tree_in_breadth_first_order(plan):
    for node, row in zip(inner(plan), plan.table.nodes, strict=True):
        assert len(node.children) == len(row.branches)
        assert row.squeeze.x_um == pytest.approx(1e3 * node.squeeze.placement[0], abs=50)
    for leaf, row in zip(leaves(plan), plan.table.leaves, strict=True):
        assert row.x_um == pytest.approx(1e3 * leaf.mode.pose[0], abs=1000)


def test_decision_map_planned_readings_lead_to_their_branches(plan):
    agree = total = 0
    for node, row in zip(inner(plan), plan.table.nodes, strict=True):
        outcome = meaning(row)
        for k in range(len(node.children)):
            for count in range(node.squeeze.clusters.low[k], node.squeeze.clusters.high[k] + 1):
                agree += outcome[count] == k
                total += 1
                assert outcome[count] >= 0
    assert agree >= 0.95 * total


def test_committed_table_has_digest_of_its_job_and_locates_part(job):
    table = load(TABLE).table
    assert table.job_digest == job_file.load(JOB).digest()
    evaluation = evaluate(table, job, make(job, seed=11), 4000, seed=12)
    figures = evaluation.summary()
    assert figures["success_rate"] >= 0.985
    assert figures["mean_squeezes"] <= 3.5
    assert figures["crashes"] == 0
    assert figures["success_ci95"][0] <= figures["success_rate"] <= figures["success_ci95"][1]


class BlindWorld:
    """A world whose squeezes all read 60 mm, which no branch contains."""

    def squeeze(self, pose_hand):
        return pose_hand, 60.0, "jammed"


def test_evaluate_unplanned_width_is_rejected_after_one_squeeze(job, plan):
    evaluation = evaluate(plan.table, job, BlindWorld(), 50, seed=1)
    assert np.all(evaluation.leaf == REJECTED)
    assert evaluation.summary()["reject_rate"] == 1.0
    assert evaluation.summary()["success_rate"] == 0.0
    assert np.all(evaluation.squeezes == 1)


L_SHAPE = "outline_mm = [[0, 0], [32, 0], [32, 12], [12, 12], [12, 26], [0, 26]]"


def l_job(proposals, **changes):
    """An L without symmetry, planned with few particles."""
    text = JOB.read_text(encoding="utf-8")
    new = {"outline_mm": L_SHAPE, "proposals": f'proposals = "{proposals}"'}
    lines = [new.get(line.split(" ")[0], line) for line in text.splitlines()]
    text = "\n".join(lines).replace("radius_mm = 12.75", "radius_mm = 10")
    return job_file.parse(text).replaced(**CERTAIN, search={"particles": 1000}).replaced(**changes)


def test_compile_job_l_shape_with_off_centre_squeezes_is_located():
    job = l_job("belief", search={"particles": 300}, uncertainty={"radius_mm": 4})
    figures = compile_job(job, workers=2, trials=500).evaluation.summary()
    assert figures["success_rate"] >= 0.97
    assert figures["mean_squeezes"] <= 4.5
    assert figures["crashes"] == 0


def test_compile_job_ambiguous_l_shape_error_names_poses_and_reading():
    job = l_job("none", search={"max_depth": 2}, friction={"doubt": 0})
    with refused_in_a_line(NoPlanError, r"the part lies at .* or .* would read") as caught:
        compile_job(job, workers=2, trials=1000)
    assert 0.3 <= caught.value.success <= 0.7


def test_compile_job_prongs_of_1_mm_differ_from_empty_jaws(job):
    """The readings of a connector's prongs are one or two counts from those of closed jaws."""
    half = [[7.5, 0], [7.5, 12.6], [6.5, 12.6], [6.5, 9.7]]
    prongs = [*half, *([-x, y] for x, y in reversed(half))]
    centres = [[0, 0], [0, 18], [18, 0]]
    pronged = job.replaced(
        part={"outline_mm": prongs, "symmetry": 1},
        uncertainty={"radius_mm": 2},
        search=FEW | {"max_depth": 2},
        actions={"angles_deg": [0, 90], "centers_mm": centres, "proposals": "none"},
        goal={"confidence": 0.9},
    )
    plan = compile_job(pronged, workers=2, trials=1000)
    every = [branch for node in plan.table.nodes for branch in node.branches]
    thin = [each for each in every if each.low_um > 0 and each.expected_um < HELD_UM]
    assert sum(branch.probability_ppm for branch in thin) > 10_000
    assert plan.evaluation.rejected.mean() < 0.05, plan.evaluation.summary()


def test_compile_job_goal_of_two_modes_names_two_poses():
    plan = compile_job(l_job("none", goal={"kind": "modes", "modes": 2}), workers=2, trials=2000)
    table = loads(dumps(plan.table))
    assert table == plan.table
    assert (table.goal.kind, table.goal.modes) == ("modes", 2)
    assert plan.evaluation.summary()["success_rate"] >= 0.96
    named = np.array([1 + len(table.leaves[leaf].alternatives) for leaf in plan.evaluation.leaf])
    assert set(named[plan.evaluation.success].tolist()) <= {1, 2}
    assert np.mean(named[plan.evaluation.success] == 2) > 0.9


@pytest.mark.parametrize(
    ("kind", "tolerance"), [("orientation", (0, 0, 87266)), ("tolerances", (2500, 2500, 87266))]
)
def test_compile_job_orientation_or_tolerance_goal_is_stored_and_judged(job, kind, tolerance):
    wanted = job.replaced(goal={"kind": kind}, search={"particles": 1000})
    plan = compile_job(wanted, workers=2, trials=1000)
    assert (plan.table.goal.kind, plan.table.goal.tolerance) == (kind, tolerance)
    assert plan.evaluation.summary()["success_rate"] >= 0.98
    known = plan.evaluation.resolved
    poses = np.array([predicted_pose(leaf) for leaf in plan.table.leaves])
    offset = plan.evaluation.poses[known] - poses[plan.evaluation.leaf[known]]
    offset[:, 2] = wrap(offset[:, 2], job.part.symmetry)
    kept = np.abs(offset[:, 2]) < np.radians(5.0)
    if kind == "tolerances":
        kept &= np.all(np.abs(offset[:, :2]) < 2.5, axis=1)
    assert np.array_equal(plan.evaluation.within[known], kept)


def test_compile_job_narrow_work_area_plans_drags_that_are_needed(job):
    area, few = {"work_area_mm": [[-30, -30], [30, 30]]}, {"particles": 1000, "max_depth": 4}
    narrow = job.replaced(cell=area, actions={"centers_mm": [[6, 0]]}, search=few)
    table = compile_job(narrow, workers=2, trials=1000).table
    assert {node.release for node in table.nodes} >= {(0, 0)}
    worlds = ContactWorlds.of_job(narrow, 3)
    assert evaluate(table, narrow, worlds, 1000, 4).success.mean() >= 0.98
    undragged = tuple(node._replace(release=None) for node in table.nodes)
    left = dataclasses.replace(table, nodes=undragged)
    assert evaluate(left, narrow, worlds, 1000, 4).success.mean() < 0.9


def test_decision_map_width_beyond_margin_ends_at_no_leaf(plan):
    """Widths farther than the margin from every planned reading end in REJECT, or lead to another squeeze."""
    margin = MARGIN_MM * 1e3
    widths = WIDTHS_UM
    answered = 0
    for node, row in zip(inner(plan), plan.table.nodes, strict=True):
        meant = meaning(row)
        for number, child in enumerate(node.children):
            asked = np.flatnonzero(meant == number)
            seen = widths[child.belief.reading]
            off = np.abs(widths[asked, None] - seen).min(axis=1)
            if not child.children and plan.table.leaves[~row.branches[number].target].resolved:
                answered += len(asked)
                assert off.max() < margin + np.ptp(widths[100:102]) + 1.0
    assert answered > 0


def test_committed_table_wrong_answers_in_standard_worlds_are_within_goal():
    """In each standard world, the share of wrong answers is at most 1 - `goal.confidence`.

    The lower end of the share's 95 % interval is compared. A tighter limit would fail by chance: with the
    encoder 1 mm off, the shares of two plans of one job differ by 0.9 %. The world of 10 degrees of freedom
    is left out.
    """
    doubting = job_file.load(JOB)
    table = load(TABLE).table
    cases = [case for case in standard_cases(doubting) if case.name != "10 degrees of freedom"]
    worlds = partial(ContactWorlds.of_job, seed=21)
    for line in sweep(table, doubting, cases, 2000, 22, worlds=worlds):
        low, _ = wilson_interval(int(line.evaluation.wrong.sum()), 2000)
        assert low <= 1.0 - doubting.goal.confidence, line.case.name
