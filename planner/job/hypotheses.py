"""What may lie on the table, where a job leaves that open: `[[hypothesis]]` entries, and the faces of a part.

    [[hypothesis]]
    name = "hex nut"            # of the part
    share = 0.5                 # of the parts that come; even where none is stated
    [hypothesis.part]           # as [part]
    [hypothesis.pressure]       # and [hypothesis.friction]: where they differ from the job's own

Each entry is the document of a job with one part. `faces = "either"` in a part stands for two of them: the
part, and the part turned over, whose outline is the mirror image.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from planner.errors import JobError, KeyNameError, ValueRangeError
from planner.job.fields import Field, Number, Text, read_section
from planner.part import symmetry

KEY = "hypothesis"
OWN = ("part", "pressure", "friction")  # sections that a hypothesis has for itself
MOST = 16
TURNED_OVER = "turned over"  # added to the name of a part that lies on its other face
TURN = np.array([1.0, -1.0, -1.0])  # what turning a part over about its x axis makes of fx, fy and torque

_FIELDS: Mapping[str, Field] = {
    "name": Text(default=None),
    "share": Number(0, 1, above=True, default=None),
}


def stated(document: Mapping[str, Any]) -> list[tuple[float, dict[str, Any]]]:
    """The share and the document of each part that a job's document names; of its only one without entries.

    Raises:
        JobError: an entry is not one, or the shares do not add up.
    """
    if KEY not in document:
        return [(1.0, dict(document))]
    entries = document[KEY]
    if not isinstance(entries, list) or not 2 <= len(entries) <= MOST:
        raise ValueRangeError(f"must be 2 to {MOST} entries, each under [[hypothesis]]", section=KEY)
    if "part" in document:
        raise KeyNameError("stands beside [[hypothesis]]; each of these has its own", section="part")
    rest = {key: value for key, value in document.items() if key != KEY}
    found = [_entry(number, entry, rest) for number, entry in enumerate(entries, start=1)]
    shares = _shares([share for share, _ in found])
    return [(share, alone) for share, (_, alone) in zip(shares, found, strict=True)]


def turned_over(document: Mapping[str, Any]) -> dict[str, Any] | None:
    """The canonical document of a part that lies on its other face; None where both faces look alike."""
    part, pressure = dict(document["part"]), dict(document["pressure"])
    outline = np.array(part["outline_mm"])
    mirrored = np.concatenate([outline[:1], outline[:0:-1]]) * np.array([1.0, -1.0]) + 0.0
    if symmetry.congruent(outline, mirrored):
        return None
    if pressure.get("quartic") is not None:
        raise ValueRangeError('of a quartic goes with one face; drop faces = "either"', section="pressure")
    if pressure.get("points_mm") is not None:
        pressure["points_mm"] = (np.array(pressure["points_mm"]) * np.array([1.0, -1.0]) + 0.0).tolist()
    if pressure.get("ellipsoid") is not None:
        pressure["ellipsoid"] = (TURN[:, None] * np.array(pressure["ellipsoid"]) * TURN + 0.0).tolist()
    part |= {"name": f"{part['name']}, {TURNED_OVER}", "outline_mm": mirrored.tolist()}
    return {**document, "part": part, "pressure": pressure}


def changed(document: dict[str, Any], section: str, replaced: Any) -> None:
    """Replaces values of a section in all entries of a document (in place); `replaced` does so in one table.

    Raises:
        ValueRangeError: parts differ in the value.
    """
    if section == "part":
        raise ValueRangeError("is not one for all; change each [[hypothesis]]", section="part")
    document[KEY] = [{**entry, section: replaced(entry.get(section, {}))} for entry in document[KEY]]


def _entry(number: int, entry: Any, rest: Mapping[str, Any]) -> tuple[float | None, dict[str, Any]]:
    where = f"{KEY} {number}"
    if not isinstance(entry, dict):
        raise ValueRangeError("must be a section of keys and values", section=where)
    own = {section: entry[section] for section in OWN if section in entry}
    values = read_section({key: entry[key] for key in entry if key not in OWN}, _FIELDS, where)
    part = own.get("part")
    if not isinstance(part, dict):
        raise KeyNameError(f"missing section part; add [{KEY}.part]", section=where)
    if values["name"] is not None:
        if part.get("name", values["name"]) != values["name"]:
            raise ValueRangeError("differs from the name of its part; keep one", section=where, key="name")
        own["part"] = {**part, "name": values["name"]}
    return values["share"], {**rest, **own}


def _shares(stated_shares: list[float | None]) -> list[float]:
    shares = [share for share in stated_shares if share is not None]
    if not shares:
        return [1.0 / len(stated_shares)] * len(stated_shares)
    if len(shares) < len(stated_shares) or abs(math.fsum(shares) - 1.0) > 1e-6:
        raise ValueRangeError("must be stated for all or none, and add up to 1", section=KEY, key="share")
    return shares


def named(document: Mapping[str, Any], number: int, error: JobError) -> JobError:
    """An error in an entry of a document, told with its number; one in what all have in common stays."""
    if KEY not in document or error.section not in OWN or error.section not in document[KEY][number - 1]:
        return error
    return type(error)(error.problem, section=f"{KEY} {number}.{error.section}", key=error.key)
