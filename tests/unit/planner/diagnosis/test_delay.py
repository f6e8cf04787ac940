"""What is still open late in a plan, where it is plain."""

from pathlib import Path

import numpy as np
import pytest
from oracle import BELIEF, SILENT, TELLING, Oracle, look_ahead

from planner.diagnosis.ambiguity import LATE, delays
from planner.job import model as job_file
from planner.lower import lower
from planner.search.actions import Action
from planner.search.expand import Growth, TreeNode, grow, squeeze_at
from planner.search.handling import handling_of

JOB = job_file.load(Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml")


def planned(silent):
    """A plan that tells nothing for some squeezes, and then which side the part lies on."""
    growth = Growth(look_ahead([TELLING]), Oracle(), handling_of(JOB), 9)
    root = leaf = TreeNode(BELIEF, 1.0, growth.objective.metric.mode(BELIEF.poses))
    for _ in range(silent):
        squeeze_at(leaf, None, Action(np.array([0.0, 0.0, SILENT])), growth, np.random.default_rng(0))
        (leaf,) = leaf.children
    leaf.squeezes_without_gain = 0
    grow(root, growth, [1])
    return root


def test_poses_that_are_still_open_late_are_named_with_their_shares():
    root = planned(LATE)
    (late,) = delays(root, JOB, 3)
    assert (late.made, late.share) == (LATE, 1.0)
    assert late.where.shares == pytest.approx((0.5, 0.5))
    assert sorted(late.where.poses[:, 0]) == pytest.approx([-6.0, 6.0])
    poses = "(6.0, 0.0) mm 0 deg (50%) or (-6.0, 0.0) mm 0 deg (50%)"
    assert late.line() == f"node 3: after 3 squeezes 100.0% of the parts lie at {poses}"
    squeeze = lower(root, JOB).nodes[late.node].squeeze
    assert squeeze.angle_urad == round(1e6 * TELLING)


def test_a_plan_that_is_done_in_time_has_none():
    assert delays(planned(LATE - 1), JOB, 3) == []


def test_no_more_than_asked_for():
    assert delays(planned(LATE), JOB, 0) == []
