"""What is still open late in a plan, where it is plain."""

from pathlib import Path

import pytest
from hand_grown import grown

from planner.diagnosis.ambiguity import LATE, delays
from planner.job import model as job_file
from planner.lower import lower

JOB = job_file.load(Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml")


def test_delays_late_node_names_open_poses_with_shares():
    late, later = delays(grown(LATE), JOB, 3)
    assert (late.squeezes, late.share) == (LATE, 1.0)
    assert late.where.shares == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    assert sorted(late.where.poses[:, 0]) == pytest.approx([-12.0, 0.0, 12.0])
    assert (later.squeezes, later.share) == (LATE + 1, pytest.approx(2 / 3))
    assert late.line().startswith("node 3: after 3 squeezes 100.0% of the parts lie at ")
    assert lower(grown(LATE), JOB).nodes[late.node].squeeze.angle_urad == 0


def test_delays_plan_that_ends_in_time_names_none():
    assert delays(grown(LATE - 2), JOB, 3) == []
