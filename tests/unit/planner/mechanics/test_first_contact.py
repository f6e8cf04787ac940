"""Where closing jaws may first meet a believed part: never later than they do."""

from pathlib import Path

import numpy as np

from planner.belief.particles import initial
from planner.job import model as job_file
from planner.mechanics.clearance import first_contact_mm, jaws_of

TREE = Path(__file__).parents[4] / "trees" / "rectangle"
JOB = job_file.load(TREE / "job.toml")


def meets(outline, pose, width_mm, jaws, share):
    """The slow twin: whether jaws closed to a width reach a part in the hand frame, along a fine raster."""
    x, y, theta = pose
    c, s = np.cos(theta), np.sin(theta)
    corners = outline @ np.array([[c, s], [-s, c]]) + np.array([x, y])
    ends = np.roll(corners, -1, axis=0)
    edge = np.concatenate(
        [a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in zip(corners, ends, strict=True)]
    )
    before = edge[np.abs(edge[:, 0]) <= 0.5 * jaws[1]]
    top = 0.5 * jaws[0] - share * (jaws[0] - width_mm)
    return bool((before[:, 1] > top).any() or (before[:, 1] < top - width_mm).any())


def test_first_contact_is_not_below_any_width_at_which_jaws_meet_a_part():
    poses = initial(JOB, 60, np.random.default_rng(5))
    jaws, shares = jaws_of(JOB.gripper), (0.4, 0.6)
    contact = first_contact_mm(JOB.part.outline_mm, jaws, poses, np.zeros(3), shares)
    for share in (*shares, 0.5):
        assert not any(
            meets(JOB.part.outline_mm, pose, contact + 0.1, jaws, share) for pose in poses
        )
    even = first_contact_mm(JOB.part.outline_mm, jaws, poses, np.zeros(3), (0.5, 0.5))
    assert any(meets(JOB.part.outline_mm, pose, even - 3.0, jaws, 0.5) for pose in poses)
    assert even <= contact <= jaws[0]


def test_first_contact_of_jaws_that_miss_every_part_is_when_they_meet():
    beside = np.array([[200.0, 0.0, 0.0]])
    assert (
        first_contact_mm(JOB.part.outline_mm, jaws_of(JOB.gripper), beside, np.zeros(3), (0.5, 0.5))
        == 0.0
    )
