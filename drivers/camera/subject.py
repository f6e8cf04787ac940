"""What is audited, from a table: its goal, its leaves, and the outline in the job it carries.

Drivers know neither planner nor runtime; the table's reader is found by its dotted name.
"""

import importlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drivers.camera.arrays import Array
from drivers.camera.auditor import Subject
from drivers.camera.judge import Goal
from drivers.camera.tag_file import PartTag, Pose

READER = "runtime.table"
SAME_MM = 1e-3
SAME_RAD = 2e-6


def from_table(path: Path, tag: PartTag) -> Subject:
    """The subject of a table's file.

    Raises:
        Exception: the reader's own errors, each with its exit code.
    """
    table = importlib.import_module(READER).load(path)
    return Subject(goal_of(table.goal), tag, outline_of(table.job), poses_of(table.leaves))


def goal_of(spec: Any) -> Goal:
    """The goal of a table (um, urad); tables of format 1 know one kind only."""
    x_um, y_um, theta_urad = getattr(spec, "tolerance", (0, 0, 0))
    return Goal(
        spec.distance_um / 1e3,
        spec.rho_um / 1e3,
        spec.symmetry,
        getattr(spec, "kind", "pose"),
        (x_um / 1e3, y_um / 1e3, theta_urad / 1e6),
    )


def outline_of(job: str | None) -> Array | None:
    """The part's outline in its own frame, (n, 2) mm; None where the table carries no job."""
    return None if job is None else np.array(json.loads(job)["part"]["outline_mm"], np.float64)


def poses_of(leaves: Sequence[Any]) -> Callable[[Pose], Sequence[Pose]]:
    """Finds the leaf of a predicted pose, and all poses that it allows."""
    known = [(_pose(leaf), tuple(map(_plain, getattr(leaf, "alternatives", ())))) for leaf in leaves]

    def allowed(pose: Pose) -> Sequence[Pose]:
        for main, others in known:
            offset = [abs(a - b) for a, b in zip(main, pose, strict=True)]
            if max(offset[:2]) < SAME_MM and offset[2] < SAME_RAD:
                return (pose, *others)
        return (pose,)

    return allowed


def _pose(leaf: Any) -> Pose:
    return _plain((leaf.x_um, leaf.y_um, leaf.theta_urad))


def _plain(pose: tuple[int, int, int]) -> Pose:
    return (pose[0] / 1e3, pose[1] / 1e3, pose[2] / 1e6)
