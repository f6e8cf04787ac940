"""The parts that an audit judges, read from a table: goal, tag, predicted poses and outline."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.camera.vision.arrays import Array
from drivers.camera.vision.tag_file import PartTag
from drivers.planar import Pose2
from runtime.shell.errors import InputError
from runtime.table import GoalSpec, Table, hypotheses_of, job_of, load, poses_of

# Greatest differences between the pose in a question and the leaf's pose that it repeats.
SAME_MM = 1e-3
SAME_RAD = 2e-6


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """A part that an audit judges: its goal, its tag and what the table predicts."""

    goal: GoalSpec
    tag: PartTag
    outline_mm: Array | None = None  # (n, 2) in the part's frame, for overlays; None: unknown
    # Returns a predicted pose and the alternatives of its leaf.
    poses_of: Callable[[Pose2], Sequence[Pose2]] = field(default=lambda pose: (pose,))
    name: str | None = None  # name of the part in a table of several parts


def from_table(path: Path, tags: Sequence[PartTag]) -> tuple[Subject, ...]:
    """Reads the parts to judge from a table, one for each tag; also raises the errors of the table's reader.

    Raises:
        InputError: there are several tags but the table is for one part, or the table lacks a tag's part.
    """
    table = load(path).table
    names = [hypothesis.name for hypothesis in table.hypotheses]
    if not names and len(tags) > 1:
        raise InputError(f"{path} is for one part, which has one tag: one --tag, not {len(tags)}")
    for tag in tags:
        if names and tag.part not in names:
            raise InputError(
                f"the tag file of {tag.part} is for no part of {path}: {', '.join(names)}"
            )
    return tuple(_subject(table, tag, names.index(tag.part) if names else 0) for tag in tags)


def _subject(table: Table, tag: PartTag, which: int) -> Subject:
    goal, leaves = table.goal, [leaf for leaf in table.leaves if leaf.hypothesis == which]
    pairs = (zip(poses_of(goal, leaf), hypotheses_of(goal, leaf), strict=True) for leaf in leaves)
    known = [[pose for pose, of in poses if of == which] for poses in pairs]

    def allowed(pose: Pose2) -> Sequence[Pose2]:
        for main, *others in known:
            offset = [abs(a - b) for a, b in zip(main, pose, strict=True)]
            if max(offset[:2]) < SAME_MM and offset[2] < SAME_RAD:
                return (pose, *others)
        return (pose,)

    job = job_of(table)
    outline = None
    if job is not None:
        part = job["hypothesis"][which]["part"] if table.hypotheses else job["part"]
        outline = np.array(part["outline_mm"], np.float64)
    name = tag.part if table.hypotheses else None
    return Subject(table.goal_of(which), tag, outline, allowed, name)
