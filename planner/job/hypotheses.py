"""Hypotheses about the part on the table: `[[hypothesis]]` entries, and the two faces of a part.

    [[hypothesis]]
    name = "hex nut"            # name of the part
    share = 0.5                 # share of the parts that come; equal shares by default
    [hypothesis.part]           # the keys of [part]
    [hypothesis.pressure]       # and [hypothesis.friction]: where they differ from the job's own

Each entry, with the sections that it shares with the others, is the document of a job with one part.
`faces = "either"` in a part stands for two hypotheses: the part, and the part turned over, whose outline is
the mirror image. `[[stranger]]` entries are foreign parts, which the plan does not locate: they have the same
keys, except for the share.
"""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from planner.errors import FitError, KeyNameError
from planner.job.fields import Field, Number, Text, read_section
from planner.part import symmetry
from runtime.shell.errors import InputError

KEY, FOREIGN = "hypothesis", "stranger"
SECTIONS = ("part", "pressure", "friction")  # sections that a hypothesis may have
MOST = 16
TURNED_OVER = "turned over"  # suffix of the name of a part that lies on its other face
# Signs of fx, fy and torque after turning a part over about its x axis.
TURN = np.array([1.0, -1.0, -1.0])

Entry: TypeAlias = tuple[float | None, dict[str, Any]]
"""The share of an entry, if it states one, and its document."""

_FIELDS: Mapping[str, Field] = {
    "name": Text(default=None),
    "share": Number(0, 1, above=True, default=None),
}


def stated(document: Mapping[str, Any]) -> list[tuple[float, dict[str, Any]]]:
    """Returns the share and the document of each hypothesis of a job's document.

    A document without `[[hypothesis]]` entries has one part, with share 1.

    Raises:
        InputError: an entry is invalid, the shares do not add up to 1, or [part] stands beside the entries.
    """
    common = {key: value for key, value in document.items() if key not in (KEY, FOREIGN)}
    if KEY not in document:
        return [(1.0, common)]
    if "part" in document:
        problem = "stands beside [[hypothesis]]; each of these has its own"
        raise KeyNameError(problem, section="part")
    result = _entries(KEY, 2, document[KEY], common)
    shares = [share for share, _ in result if share is not None]
    if not shares:
        return [(1.0 / len(result), alone) for _, alone in result]
    if len(shares) < len(result) or abs(math.fsum(shares) - 1.0) > 1e-6:
        problem = "must be stated for all or none, and add up to 1"
        raise InputError(problem, section=KEY, key="share")
    return [(share, alone) for share, (_, alone) in zip(shares, result, strict=True)]


def foreign(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Returns the document of each foreign part of a job's document.

    Raises:
        InputError: an entry is invalid, or states a share.
    """
    common = {key: value for key, value in document.items() if key not in (KEY, FOREIGN, "part")}
    result = _entries(FOREIGN, 1, document[FOREIGN], common) if FOREIGN in document else []
    for number, (share, _) in enumerate(result, start=1):
        if share is not None:
            problem = "no plan is made for it, so it has no share; drop the key"
            raise KeyNameError(problem, section=f"{FOREIGN} {number}", key="share")
    return [alone for _, alone in result]


def turned_over(document: Mapping[str, Any]) -> dict[str, Any] | None:
    """Returns the document of a part that lies on its other face; None where both faces look alike.

    Args:
        document: the canonical document of the part as stated.

    Raises:
        InputError: the part's limit surface is a quartic, or both faces look alike and the part has picks.
    """
    part, pressure = dict(document["part"]), dict(document["pressure"])
    outline = np.array(part["outline_mm"])
    mirrored = np.concatenate([outline[:1], outline[:0:-1]]) * np.array([1.0, -1.0]) + 0.0
    if symmetry.congruent(outline, mirrored):
        if part.get("picks"):
            problem = "hold for one face, and no squeeze tells the faces apart"
            raise InputError(
                f'{problem}; drop them, or faces = "either"', section="part", key="picks"
            )
        return None
    if pressure.get("quartic") is not None:
        problem = 'of a quartic goes with one face; drop faces = "either"'
        raise InputError(problem, section="pressure")
    if pressure.get("points_mm") is not None:
        points = np.array(pressure["points_mm"]) * np.array([1.0, -1.0]) + 0.0
        pressure["points_mm"] = points.tolist()
    if pressure.get("ellipsoid") is not None:
        turned = TURN[:, None] * np.array(pressure["ellipsoid"]) * TURN + 0.0
        pressure["ellipsoid"] = turned.tolist()
    part |= {"name": f"{part['name']}, {TURNED_OVER}", "outline_mm": mirrored.tolist()}
    # A mirrored frame is left-handed. So the datum's y axis is reversed, and with it the picks' y and angle.
    if part.get("datum") is not None:
        part["datum"] = _mirrored(part["datum"])
        picks = {name: _mirrored(pick) for name, pick in (part.get("picks") or {}).items()}
        part["picks"] = picks or None
    return {**document, "part": part, "pressure": pressure}


def _mirrored(pose: list[float]) -> list[float]:
    """A pose [mm, mm, deg] of a part turned over about its x axis."""
    x, y, angle = pose
    return [x, 0.0 - y, 0.0 - angle]


def _entries(key: str, least: int, entries: Any, common: Mapping[str, Any]) -> list[Entry]:
    """Checks the list `key`; returns the share and the document of each entry.

    The share is None where an entry states none; `common` are the sections that entries share.
    """
    if not isinstance(entries, list) or not least <= len(entries) <= MOST:
        raise InputError(f"must be {least} to {MOST} entries, each under [[{key}]]", section=key)
    numbered = enumerate(entries, start=1)
    return [_entry(key, f"{key} {number}", entry, common) for number, entry in numbered]


def _entry(key: str, where: str, entry: Any, common: Mapping[str, Any]) -> Entry:
    if not isinstance(entry, dict):
        raise InputError("must be a section of keys and values", section=where)
    sections = {section: entry[section] for section in SECTIONS if section in entry}
    alone = {name: value for name, value in entry.items() if name not in SECTIONS}
    values = read_section(alone, _FIELDS, where)
    part = sections.get("part")
    if not isinstance(part, dict):
        raise KeyNameError(f"missing section part; add [{key}.part]", section=where)
    if values["name"] is not None:
        if part.get("name", values["name"]) != values["name"]:
            problem = "differs from the name of its part; keep one"
            raise InputError(problem, section=where, key="name")
        sections["part"] = {**part, "name": values["name"]}
    if "friction" not in {**common, **sections}:
        problem = f"missing section friction; add [{key}.friction], or [friction] for all"
        raise KeyNameError(problem, section=where)
    return values["share"], {**common, **sections}


def named(document: Mapping[str, Any], key: str, number: int, error: InputError) -> InputError:
    """Returns a copy of an error that also names the entry at fault, as number `number` of the list `key`.

    Numbers count from 1. If the section at fault stands in the entry, its name becomes, for example,
    "hypothesis 2.part". If the section is common to all entries, the copy names no entry, except for a
    `FitError`, whose message then begins with "hypothesis 2". If the document has no list `key`, `error`
    itself is returned.
    """
    if key not in document:
        return error
    if error.section in SECTIONS and error.section in document[key][number - 1]:
        return type(error)(error.problem, section=f"{key} {number}.{error.section}", key=error.key)
    message = f"{key} {number}: {error.problem}" if isinstance(error, FitError) else error.problem
    return type(error)(message, section=error.section, key=error.key)
