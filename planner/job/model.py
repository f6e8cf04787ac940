"""The job file: everything a plan depends on, checked once, then frozen.

A job is TOML for people (`load`, `parse`) and canonical JSON for the table (`Job.canonical`,
`from_canonical`): the same keys, with every default written out. The text is exact, so its digest names the
job.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.errors import JobError
from planner.job import checks as job_checks
from planner.job import documents, schema, surface_file
from planner.part import symmetry
from planner.part.pressure import Pressure


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A checked job. Two jobs are equal if their canonical texts are."""

    seed: int
    part: schema.Part
    pressure: Pressure
    friction: schema.Friction
    gripper: schema.Gripper
    release: schema.Release
    doubt: schema.Doubt
    uncertainty: schema.Uncertainty
    actions: schema.Actions
    goal: schema.Goal
    search: schema.Search
    cell: schema.Cell
    delivery: schema.Delivery | None = None

    @classmethod
    def load(cls, path: str | Path, changes: Mapping[str, Any] | None = None) -> Job:
        """Reads a job file (TOML, UTF-8), with changes as `Job.replaced` takes them.

        Raises:
            InputFileError: the file is missing, unreadable, a directory or not UTF-8.
            JobError: as `parse`.
        """
        return parse(documents.read(path), str(path), changes)

    def canonical(self) -> str:
        """The job as canonical JSON: keys sorted, no spaces, floats exact (shortest repr)."""
        return json.dumps(_plain(asdict(self)), sort_keys=True, separators=(",", ":"), allow_nan=False)

    def digest(self) -> bytes:
        """The SHA-256 of the canonical text, 32 bytes."""
        return hashlib.sha256(self.canonical().encode()).digest()

    def replaced(self, where: str = "the changed job", /, **changes: Any) -> Job:
        """A copy with other values, checked as in a file: `job.replaced(goal={"modes": 2}, seed=4)`.

        `where` is what an error names as the place. Another `pressure.kind` drops the keys that only the old
        one takes.

        Raises:
            JobError: as `parse`.
        """
        document = documents.changed(_plain(asdict(self)), _plain(changes), where)
        drawn = "outline_mm" in changes.get("part", ()) or "surface_file" in changes.get("pressure", ())
        return of_document(document, where, drawn)

    def __eq__(self, other: object) -> bool:
        return self.canonical() == other.canonical() if isinstance(other, Job) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.canonical())


load = Job.load


def files(path: str | Path) -> list[Path]:
    """The files that `load` reads: the job file, and what it names.

    Raises:
        JobError: as `load`.
    """
    document = documents.from_toml(documents.read(path), str(path))
    pressure = document.get("pressure")
    named = pressure.get("surface_file") if isinstance(pressure, dict) else None
    return [Path(path), *([Path(path).parent / named] if isinstance(named, str) else [])]


def centroid_as_drawn(path: str | Path) -> Array:
    """Where the part's origin (2,) lies in the frame in which the job file writes `outline_mm` [mm].

    Raises:
        JobError: as `load`.
    """
    document = documents.from_toml(documents.read(path), str(path))
    return -job_checks.place_outline(document["part"]["outline_mm"], drawn=True).shift_mm


def parse(text: str, where: str = "job", changes: Mapping[str, Any] | None = None) -> Job:
    """Parses a job from the TOML text of the file `where`, with changes as `Job.replaced` takes them.

    Raises:
        TomlError: not valid TOML.
        KeyNameError: an unknown or missing key or section.
        ValueRangeError: a value of the wrong type, out of range, or in conflict with another.
        OutlineError: the outline is not a simple polygon.
        FitError: the part does not pass between the open fingers in any orientation.
    """
    return of_document(
        documents.changed(documents.from_toml(text, where), changes or {}, where), where, drawn=True
    )


def from_canonical(text: str, where: str = "job text") -> Job:
    """Reads a job back from its canonical text, exactly: `from_canonical(job.canonical()) == job`.

    Raises:
        TomlError: not valid JSON.
        JobError: as `parse`.
    """
    return of_document(documents.from_json(text, where), where, drawn=False)


def of_document(document: dict[str, Any], where: str, drawn: bool) -> Job:
    """Checks a document and freezes it; only an outline as drawn is moved to its centroid.

    Raises:
        JobError: as `parse`.
    """
    try:
        return _of_document(document, where, drawn)
    except JobError as error:
        raise error.at(where) from error.__cause__


def _of_document(document: dict[str, Any], where: str, drawn: bool) -> Job:
    values = documents.checked(document)
    part, actions, cell = values["part"], values["actions"], values["cell"]
    part["outline_mm"], shift = job_checks.place_outline(part["outline_mm"], drawn)
    if part["datum"] is not None:
        part["datum"] = part["datum"] + np.array([*shift, 0.0])
        part["datum"].setflags(write=False)
    if part["symmetry"] == "auto":
        part["symmetry"] = symmetry.order(part["outline_mm"])
    surface_file.resolve(values["pressure"], where, drawn)
    job_checks.place_supports(values["pressure"], part["outline_mm"], shift)
    if cell["squeeze_height_mm"] is None:
        cell["squeeze_height_mm"] = job_checks.tips_height_mm(part["height_mm"])
    job_checks.check_conflicts(values)
    for key in ("angles_deg", "openings_mm", "forces_n"):
        actions[key] = tuple(actions[key].tolist())
    for key in ("finger_share", "middle_mm", "encoder_mm", "encoder_gain"):
        values["doubt"][key] = tuple(values["doubt"][key].tolist())
    values["goal"]["tolerance_mm"] = tuple(values["goal"]["tolerance_mm"].tolist())
    cell["work_area_mm"] = tuple(map(tuple, cell["work_area_mm"].tolist()))
    records = {name: values[name] and record(**values[name]) for name, record in schema.SECTIONS.items()}
    return Job(seed=values[""]["seed"], **records)


def _plain(value: Any) -> Any:
    """A value as JSON types; keys that are None are not written."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    return value.tolist() if isinstance(value, np.ndarray) else value
