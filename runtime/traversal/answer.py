"""The answer for a located part: the part's name and pose, and the poses of its datum and named grasps."""

from math import degrees, radians
from typing import NamedTuple

from runtime.table import Pose2, Table, TableError, job_of, predicted_pose
from runtime.table.embedded import parts_of
from runtime.table.geometry import compose
from runtime.traversal.results import PartResult

CENTRE = (0.0, 0.0, 0.0)


class PartFrames(NamedTuple):
    """Datum and named grasps (picks) of a part, in the frame of its outline: mm, mm, rad."""

    datum: Pose2 | None
    picks: dict[str, Pose2]


NO_FRAMES = PartFrames(None, {})


def frames_of(table: Table) -> tuple[PartFrames, ...]:
    """The frames of each part of a table, as the job inside the table states them.

    All are `NO_FRAMES` if the table has no readable job, or if the job has another number of parts.
    """
    count = max(1, len(table.hypotheses))
    try:
        listed = parts_of(job_of(table) or {})
    except TableError:
        listed = []
    frames = tuple(frames_in(entry.get("part")) for entry in listed)
    return frames if len(frames) == count else (NO_FRAMES,) * count


def frames_in(part: object) -> PartFrames:
    """The frames that a job's section `part` states; `NO_FRAMES` for an invalid section."""
    try:
        assert isinstance(part, dict)
        stated = part.get("datum")
        datum = None if stated is None else _pose(stated)
        named = ((str(name), _pose(pick)) for name, pick in part.get("picks", {}).items())
        picks = {name: compose(datum or CENTRE, pick) for name, pick in named}
    except (AssertionError, AttributeError, TypeError, ValueError):
        return NO_FRAMES
    return PartFrames(datum, picks)


def fields(table: Table, result: PartResult, frames: tuple[PartFrames, ...]) -> dict[str, object]:
    """The answer for a part that ended at a leaf, as fields of a record.

    The fields are the poses of the part, of its datum and of each named grasp and, for a table of several
    parts, the part's name. `frames` is the result of `frames_of`.
    """
    end = result.leaf_of(table)
    assert end is not None
    pose, (datum, picks) = predicted_pose(end), frames[end.hypothesis]
    named = {"hypothesis": table.name_of(end)} if table.hypotheses else {}
    shown = None if datum is None else as_degrees(compose(pose, datum))
    placed = {name: as_degrees(compose(pose, pick)) for name, pick in picks.items()}
    return {**named, **as_degrees(pose), "datum": shown, "picks": placed}


def outcome_fields(table: Table, result: PartResult) -> dict[str, object]:
    """A result as fields of a journal record, with the part's name if the table gives one."""
    name = None if result.leaf is None else table.name_of(table.leaves[result.leaf])
    return result.fields() if name is None else {**result.fields(), "hypothesis": name}


def as_degrees(pose: Pose2) -> dict[str, float]:
    """A pose (mm, mm, rad) as fields in mm and degrees, with the units in their names."""
    x_mm, y_mm, angle_rad = pose
    return {
        "x_mm": round(x_mm, 3),
        "y_mm": round(y_mm, 3),
        "angle_deg": round(degrees(angle_rad), 3),
    }


def _pose(numbers: object) -> Pose2:
    x_mm, y_mm, angle_deg = (float(value) for value in numbers)  # type: ignore[attr-defined]
    return x_mm, y_mm, radians(angle_deg)
