"""The likeliest path through a table, step by step: possible poses after each squeeze, and one part."""

from itertools import takewhile
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.belief.particles import subsample
from planner.evaluation.trials import placement_of
from planner.job.model import Job
from planner.mechanics.clearance import jaws_of
from planner.report import canvas
from planner.report.paper_figures import likeliest_path, track
from planner.report.replay import Replay
from runtime.table import Table

OUTLINES = 60  # most outlines of one belief
SQUEEZES = range(1, 4)  # most of them beside each other on a page


class Scene(NamedTuple):
    """Possible poses of the parts at one moment, and the pose of one of them."""

    caption: str
    belief: Array  # (m, 4) states of the parts, as `with_hypothesis`
    closed: Array  # (0 or 2, 4, 2) fingers, closed to the expected width [mm]
    before: Array  # (4,) of the one part
    after: Array  # and after the squeeze
    holding: Array  # (0 or 2, 4, 2) fingers, closed to its width [mm]


def scenes(table: Table, job: Job, beliefs: Replay) -> list[Scene]:
    """The moments before the first squeeze and after each."""
    whole = likeliest_path(table, beliefs, SQUEEZES)
    # For a table that dismisses all parts, up to there.
    path = list(takewhile(lambda at: np.any(beliefs.visits[at.node].branch == at.branch), whole))
    part = track(beliefs, path)
    hypothesis = beliefs.arrivals[0][part.part, 3:]
    poses = [np.append(pose, hypothesis) for pose in part.poses]
    none, jaws = np.empty((0, 4, 2)), jaws_of(job.gripper)
    belief = subsample(beliefs.arrivals[0], OUTLINES)
    result = [Scene("Before: all parts", belief, none, poses[0], poses[0], none)]
    for k, step in enumerate(path):
        node = table.nodes[step.node]
        branch, hand = node.branches[step.branch], placement_of(node.squeeze)
        target = branch.target
        states = beliefs.arrivals[target] if target >= 0 else beliefs.leaves[~target]
        width_mm, share = branch.expected_um / 1e3, len(states) / len(beliefs.arrivals[0])
        squeeze = f"Squeeze {k + 1} at {np.degrees(hand[2]):.0f}°"
        caption = f"{squeeze} reads {width_mm:.1f} mm: {share:.0%} of the parts"
        closed, holding = (
            canvas.placed(canvas.finger_boxes(jaws, width), hand)
            for width in (width_mm, part.widths_mm[k])
        )
        states = subsample(states, OUTLINES)
        result.append(Scene(caption, states, closed, poses[k], poses[k + 1], holding))
    return result
