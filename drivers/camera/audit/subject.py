"""What is audited, from a table: its goal, its leaves, and the outline in the job it carries."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.camera.vision.arrays import Array
from drivers.camera.vision.tag_file import PartTag
from drivers.planar import Pose2
from runtime.table import GoalSpec, job_of, load, poses_of

SAME_MM = 1e-3
SAME_RAD = 2e-6


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """What is audited."""

    goal: GoalSpec
    tag: PartTag
    outline_mm: Array | None = None  # (n, 2) in the part's frame, for overlays; None: not known
    # A predicted pose, and others that its leaf allows.
    poses_of: Callable[[Pose2], Sequence[Pose2]] = field(default=lambda pose: (pose,))


def from_table(path: Path, tag: PartTag) -> Subject:
    """The subject of a table's file; errors of the table's reader pass as they are."""
    table = load(path).table
    known = [poses_of(table.goal, leaf) for leaf in table.leaves]

    def allowed(pose: Pose2) -> Sequence[Pose2]:
        for main, *others in known:
            offset = [abs(a - b) for a, b in zip(main, pose, strict=True)]
            if max(offset[:2]) < SAME_MM and offset[2] < SAME_RAD:
                return (pose, *others)
        return (pose,)

    job = job_of(table)
    outline = None if job is None else np.array(job["part"]["outline_mm"], np.float64)
    return Subject(table.goal, tag, outline, allowed)
