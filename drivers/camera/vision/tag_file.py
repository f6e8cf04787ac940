"""The tag of a part, and its place on the part: measured once for a part, kept in a file."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drivers.camera import documents
from drivers.camera.vision.tags import FAMILY
from drivers.planar import Pose2

KIND = "part tag"
REMEDY = "make it again with grasp-calibrate tag"
PLACE = ("x_mm", "y_mm", "theta_rad")
LENGTHS = ("side_mm", "height_mm", "sigma_mm", "sigma_rad")


@dataclass(frozen=True, slots=True)
class PartTag:
    """A tag on a part, its size and its pose on the part."""

    part: str  # name of the part
    number: int  # the tag's id
    side_mm: float  # edge of the tag's black border
    on_part: Pose2 = (0.0, 0.0, 0.0)  # pose of the tag in the part's frame: mm, mm, rad
    height_mm: float = 0.0  # height of the tag's face above the table
    sigma_mm: float = 0.0  # standard deviation of `on_part`'s place
    sigma_rad: float = 0.0  # standard deviation of `on_part`'s angle


def save(tag: PartTag, path: Path, date: str) -> None:
    """Writes a tag and a date (ISO 8601) to a file; raises OutputError if the file cannot be written."""
    fields = asdict(tag)
    place = dict(zip(PLACE, fields.pop("on_part"), strict=True))
    documents.save(path, KIND, {"date": date, "family": FAMILY, **fields, **place})


def load(path: Path) -> PartTag:
    """Reads a tag from a file; raises InputError if it is unreadable, changed, or of another family."""
    return documents.read(path, KIND, REMEDY, _parsed)


def _parsed(record: dict[str, Any]) -> PartTag:
    if record["family"] != FAMILY:
        raise ValueError(f"family {record['family']}; {FAMILY} is known")
    x_mm, y_mm, theta_rad = (float(record[key]) for key in PLACE)
    side_mm, *rest = (float(record[key]) for key in LENGTHS)
    place = (x_mm, y_mm, theta_rad)
    tag = PartTag(str(record["part"]), int(record["number"]), side_mm, place, *rest)
    if not tag.side_mm > 0.0:
        raise ValueError("side_mm must be positive")
    return tag
