"""Drafts the job file of a new part from an outline and a few answers: commented TOML, ready to compile.

The values for grippers and finger materials are starting values, to be measured in the cell.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from planner.job import model as job_file
from planner.job.checks import doubt_mm
from planner.part.importers.file import Face, Imported
from planner.part.outline import reach
from planner.part.tips import tips_height_mm
from planner.templating import environment
from runtime.shell.plain_text import cleaned
from runtime.table import selectable

GRIPPERS = selectable()  # profiles by model
MIDDLE_SHARE = 1 / 60  # share of the stroke by which fingers may meet off the hand's middle


class Fingers(NamedTuple):
    """A finger material, with bounds on its coefficient of dry friction against metals and plastics."""

    low: float
    high: float
    material: str


FINGERS = {
    "rubber": Fingers(0.5, 0.9, "rubber or polyurethane pads"),
    "silicone": Fingers(0.6, 1.0, "silicone pads"),
    "aluminium": Fingers(0.25, 0.5, "bare aluminium"),
    "steel": Fingers(0.1, 0.3, "bare steel"),
    "plastic": Fingers(0.2, 0.4, "nylon, POM or printed plastic"),
    "unknown": Fingers(0.2, 0.8, "unknown: a wide interval costs squeezes, not correctness"),
}


MOST_RADIUS_MM = 10.0  # largest radius that is proposed
FITTING = 0.8  # proposed radius, as a share of `room_mm`
LONGEST_NAME = 60  # characters of a name that nobody chose; faces add to it
DECIMALS = 4  # Decimals of a vertex [mm]: 0.1 um, far below any tolerance of a drawing


class Answers(NamedTuple):
    """Settings of a job that a drawing does not contain, such as the gripper and the finger material."""

    name: str  # name of the part
    radius_mm: float  # radius of the disc in which the part's centroid lies
    turn_deg: float | None  # the part is turned by at most this, either way; None: by any angle
    gripper: str  # one of `GRIPPERS`
    fingers: str  # one of `FINGERS`
    distance_mm: float = 3.0  # distance of the goal, see `schema.Goal`
    height_mm: float | None = None  # the part's thickness; None: unknown
    tips_mm: float | None = None  # height of the finger tips above the table; None: the default


def name_of(drawing: Path) -> str:
    """The name of a part that nobody has named: that of its drawing, as far as a job can hold it."""
    return cleaned(drawing.stem)[:LONGEST_NAME].strip() or "part"


def draft(imported: Imported, source: str, answers: Answers, faces: Sequence[Face] = ()) -> str:
    """Returns the text of a job file for an outline that was read from the file `source`.

    Each of `faces`, on which a solid may lie, becomes a hypothesis. The text is checked like every job.

    Raises:
        InputError: the part does not fit the gripper, or an answer is out of range.
    """
    profile, opening_mm = GRIPPERS[answers.gripper], opening_of(answers.gripper)
    templates = environment("planner", markup=False)
    templates.filters["toml"] = lambda text: json.dumps(text, ensure_ascii=False)
    thickness = None if answers.height_mm is None else round(float(answers.height_mm), DECIMALS)
    tips = faces[0].cut_mm if faces else answers.tips_mm or tips_height_mm(thickness)
    text = templates.get_template("job.toml").render(
        name=cleaned(answers.name),
        source=cleaned(source),
        order=imported.symmetry,
        height=thickness,
        tips=tips,
        **_shape(imported),
        faces=[_face(number, face, answers.name) for number, face in enumerate(faces, start=1)],
        datum=[round(float(value), DECIMALS) + 0.0 for value in imported.origin_mm],
        datum_name=imported.origin_name,
        fingers=FINGERS[answers.fingers],
        gripper=profile,
        opening=opening_mm,
        middle_off=round(MIDDLE_SHARE * opening_mm, 1),
        encoder_off=doubt_mm(profile.resolution_um / 1000, profile.noise_um / 1000),
        radius=float(answers.radius_mm),
        turn=None if answers.turn_deg is None else float(answers.turn_deg),
        distance=float(answers.distance_mm),
    )
    job_file.parse(text, "the new job")
    return text


def _face(number: int, face: Face, name: str) -> dict[str, object]:
    assert face.imported.height_mm is not None
    return {
        "name": f"{name}, face {number}",
        "share": round(face.share, 9),
        "down": face.down_text,
        "height": round(face.imported.height_mm, DECIMALS),
        **_shape(face.imported),
    }


def _shape(imported: Imported) -> dict[str, object]:
    width, height = imported.size_mm
    return {
        "size": f"{width:.3f} x {height:.3f}",
        "notes": [cleaned(note) for note in imported.notes],
        "vertices": np.round(imported.outline_mm, DECIMALS).tolist(),
    }


def opening_of(gripper: str) -> float:
    """The distance between the open jaws of a gripper [mm]; `gripper` is the name of its model."""
    return GRIPPERS[gripper].stroke_um / 1000


def room_mm(imported: Imported, gripper: str) -> float:
    """Largest distance between hand and part at which the open fingers still clear the part [mm].

    The distance is that of the part's centroid from the hand's middle; the part may lie at any angle. The
    result is negative if the jaws open less than twice the part's reach.
    """
    return 0.5 * opening_of(gripper) - reach(imported.outline_mm)


def proposed_radius_mm(imported: Imported, gripper: str) -> float:
    """Proposes the radius of the disc in which a part's centroid lies [mm]: a whole number of at least 1."""
    return max(1.0, float(math.floor(min(MOST_RADIUS_MM, FITTING * room_mm(imported, gripper)))))
