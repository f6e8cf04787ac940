"""What is told of a located part: its pose, in the drawing's datum too, and where to take it."""

from math import degrees, radians
from typing import NamedTuple

from runtime.table import Pose2, Table, TableError, job_of, predicted_pose
from runtime.traversal.geometry import compose

CENTRE = (0.0, 0.0, 0.0)


class PartFrames(NamedTuple):
    """Frames that the job names, in the frame of the part's outline: mm, mm, rad."""

    datum: Pose2 | None
    picks: dict[str, Pose2]


def frames_of(table: Table) -> PartFrames:
    """Those of a table's job; none where it was stripped or is of another make."""
    try:
        return frames_in((job_of(table) or {}).get("part"))
    except TableError:
        return PartFrames(None, {})


def frames_in(part: object) -> PartFrames:
    """Those of a job's section `part`; none where it is no such section."""
    try:
        assert isinstance(part, dict)
        stated = part.get("datum")
        datum = None if stated is None else _pose(stated)
        picks = {
            str(name): compose(datum or CENTRE, _pose(pick)) for name, pick in part.get("picks", {}).items()
        }
    except (AssertionError, AttributeError, TypeError, ValueError):
        return PartFrames(None, {})
    return PartFrames(datum, picks)


def told(table: Table, leaf: int, frames: PartFrames) -> dict[str, object]:
    """The answer of a leaf for machines: the pose of the outline's frame, of the datum, and of each pick."""
    pose = predicted_pose(table.leaves[leaf])
    return {
        **as_degrees(pose),
        "datum": None if frames.datum is None else as_degrees(compose(pose, frames.datum)),
        "picks": {name: as_degrees(compose(pose, pick)) for name, pick in frames.picks.items()},
    }


def as_degrees(pose: Pose2) -> dict[str, float]:
    """A pose with its units in the names."""
    x_mm, y_mm, angle_rad = pose
    return {"x_mm": round(x_mm, 3), "y_mm": round(y_mm, 3), "angle_deg": round(degrees(angle_rad), 3)}


def _pose(numbers: object) -> Pose2:
    x_mm, y_mm, angle_deg = (float(value) for value in numbers)  # type: ignore[attr-defined]
    return x_mm, y_mm, radians(angle_deg)
