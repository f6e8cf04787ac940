"""The job file: all inputs of a plan, checked once, then frozen.

A job is TOML for people (`load`, `parse`) and canonical JSON for the table (`Job.canonical`,
`from_canonical`): the same keys, with every default written out. The JSON text is exact, so its digest
identifies the job.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.job import checks as job_checks
from planner.job import documents, hypotheses, schema, surface_file
from planner.part import symmetry
from planner.part.pressure import Pressure
from planner.part.tips import tips_height_mm
from runtime.shell.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class ForeignPart:
    """A part that does not belong in the cell: plans do not locate it, but tables are tested with it."""

    part: schema.Part
    pressure: Pressure
    friction: schema.Friction


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis(ForeignPart):
    """One of the kinds of parts, or faces of a part, that may lie on the table, and its share."""

    share: float  # fraction of all parts that come


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A checked job. Two jobs are equal if their canonical texts are equal."""

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
    # The hypotheses; None if there is only one. Part, pressure and friction above belong to the first
    # hypothesis.
    hypothesis: tuple[Hypothesis, ...] | None = None
    foreign: tuple[ForeignPart, ...] | None = None

    @property
    def alone(self) -> tuple[Job, ...]:
        """One job for every hypothesis, with this hypothesis alone; for a job of one part, the job itself."""
        return self._each(self.hypothesis) or (self,)

    @property
    def foreign_parts(self) -> tuple[Job, ...]:
        """One job for every foreign part; this part is the only part in it."""
        return self._each(self.foreign)

    def _each(self, parts: Sequence[ForeignPart] | None) -> tuple[Job, ...]:
        alone = replace(self, hypothesis=None, foreign=None)
        return tuple(
            replace(alone, part=each.part, pressure=each.pressure, friction=each.friction)
            for each in parts or ()
        )

    @property
    def shares(self) -> tuple[float, ...]:
        """The share of each hypothesis among all parts, in the order of `alone`; the sum is 1."""
        return tuple(h.share for h in self.hypothesis) if self.hypothesis else (1.0,)

    @property
    def name(self) -> str:
        """Names of the parts of the job, as text for people."""
        return " or ".join(job.part.name for job in self.alone)

    @classmethod
    def load(cls, path: str | Path, changes: Mapping[str, Any] | None = None) -> Job:
        """Reads a job file (TOML, UTF-8) and applies changes in the form of `Job.replaced`.

        Raises:
            InputError: the file cannot be read; or see `parse`.
        """
        return parse(documents.read(path), str(path), changes)

    def canonical(self) -> str:
        """The job as canonical JSON: keys sorted, no spaces, floats exact (shortest repr)."""
        return json.dumps(_document(self), sort_keys=True, separators=(",", ":"), allow_nan=False)

    def digest(self) -> bytes:
        """The SHA-256 of the canonical text, 32 bytes."""
        return hashlib.sha256(self.canonical().encode()).digest()

    def replaced(self, where: str = "the changed job", /, **changes: Any) -> Job:
        """Returns a copy with other values: `job.replaced(goal={"modes": 2}, seed=4)`.

        The copy is checked like a job file; errors name `where` as the place. A new `pressure.kind` drops
        the keys that only the old kind has.

        Raises:
            InputError: see `parse`.
        """
        document = documents.changed(_document(self), _plain(changes), where)
        part, pressure = (changes.get(section, ()) for section in ("part", "pressure"))
        drawn = "outline_mm" in part or "surface_file" in pressure
        return of_document(document, where, drawn)

    def __eq__(self, other: object) -> bool:
        return self.canonical() == other.canonical() if isinstance(other, Job) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.canonical())


load = Job.load


def files(path: str | Path) -> list[Path]:
    """The files that `load` reads: the job file, and the files that it names.

    Raises:
        InputError: see `load`.
    """
    document = documents.from_toml(documents.read(path), str(path))
    lists = (document.get(key) for key in (hypotheses.KEY, hypotheses.FOREIGN))
    listed = [entry for entries in lists if isinstance(entries, list) for entry in entries]
    tables = [document, *(entry for entry in listed if isinstance(entry, dict))]
    stated = [table["pressure"] for table in tables if isinstance(table.get("pressure"), dict)]
    names = [table.get("surface_file") for table in stated]
    return [Path(path), *(Path(path).parent / name for name in names if isinstance(name, str))]


def centroid_as_drawn(path: str | Path) -> Array:
    """Returns the centroid (2,) of a job file's outline, in the coordinates of the file [mm].

    Raises:
        InputError: see `load`.
    """
    document = documents.from_toml(documents.read(path), str(path))
    return -job_checks.place_outline(document["part"]["outline_mm"], drawn=True).shift_mm


def parse(text: str, where: str = "job", changes: Mapping[str, Any] | None = None) -> Job:
    """Parses a job from TOML text of the file `where`; `changes` are in the form of `Job.replaced`.

    Raises:
        InputError: the text is not valid TOML; a value is of the wrong type, out of range or in conflict with
            another; or an outline is not a simple polygon.
        KeyNameError: a key or section is unknown or missing.
        FitError: the part does not pass between the open fingers in any orientation.
    """
    document = documents.changed(documents.from_toml(text, where), changes or {}, where)
    return of_document(document, where, drawn=True)


def from_canonical(text: str, where: str = "job text") -> Job:
    """Reads a job back from its canonical text, exactly: `from_canonical(job.canonical()) == job`.

    Raises:
        InputError: the text is not valid JSON; or see `parse`.
    """
    return of_document(documents.from_json(text, where), where, drawn=False)


def of_document(document: dict[str, Any], where: str, drawn: bool) -> Job:
    """Returns the job of a document, checked and frozen.

    Args:
        document: the parsed job.
        where: the job's file, for errors.
        drawn: whether the outline is as a person drew it, and has to be centred; in the canonical form it is
            centred already.

    Raises:
        InputError: see `parse`.
    """
    try:
        return _of_document(document, Path(where).parent if drawn else None)
    except InputError as error:
        raise error.at(where) from error.__cause__


def _of_document(document: dict[str, Any], folder: Path | None) -> Job:
    """Returns the job of a document, with a hypothesis for each part and face if there are several.

    `folder` is the folder of the job file that a person wrote; None for the canonical form.
    """
    results: list[tuple[float, Job]] = []
    shares, listed = zip(*hypotheses.stated(document), strict=True)
    named = _jobs(document, hypotheses.KEY, listed, folder)
    for share, jobs in zip(shares, named, strict=True):
        results += [(share / len(jobs), job) for job in jobs]
    others = _jobs(document, hypotheses.FOREIGN, hypotheses.foreign(document), folder)
    each = itertools.chain.from_iterable(others)
    foreign = tuple(ForeignPart(job.part, job.pressure, job.friction) for job in each)
    first = replace(results[0][1], foreign=foreign or None)
    job_checks.refuse(job_checks.of_parts(first, [job.part.name for _, job in results]))
    if len(results) == 1:
        return first
    lowest_mm = min(job.cell.squeeze_height_mm for _, job in results)
    search = first.search
    if "particles" not in document.get("search", {}):
        search = replace(search, particles=search.particles * len(results))
    parts = tuple(Hypothesis(job.part, job.pressure, job.friction, share) for share, job in results)
    cell = replace(first.cell, squeeze_height_mm=lowest_mm)
    return replace(first, cell=cell, search=search, hypothesis=parts)


def _jobs(
    document: dict[str, Any], key: str, listed: Sequence[dict[str, Any]], folder: Path | None
) -> list[list[Job]]:
    """Returns the jobs of each part of the list `key`: one job for each face on which the part may lie.

    Args:
        document: the document of the whole job, which may contain the list.
        key: name of the list, for errors (`hypotheses.named`).
        listed: a document for each part.
        folder: see `_of_document`.
    """
    results = []
    for number, alone in enumerate(listed, start=1):
        try:
            results.append(_on_faces(alone, folder))
        except InputError as error:
            raise hypotheses.named(document, key, number, error) from None
    return results


def _on_faces(document: dict[str, Any], folder: Path | None) -> list[Job]:
    """Returns the job of a part as stated and, if needed, the job of the part on its other face.

    The second job is needed if the document states `faces` and the two faces do not look alike.
    """
    part = document.get("part")
    faces = part.get("faces") if isinstance(part, dict) else None
    job = _of_one(document, folder)
    other = hypotheses.turned_over(_document(job)) if faces is not None else None
    return [job] if other is None else [job, _of_one(other, None)]


def _of_one(document: dict[str, Any], folder: Path | None) -> Job:
    values = documents.checked(document)
    part, cell = values["part"], values["cell"]
    del part["faces"]
    part["outline_mm"], shift = job_checks.place_outline(part["outline_mm"], folder is not None)
    if part["datum"] is not None:
        part["datum"] = part["datum"] + np.array([*shift, 0.0])
        part["datum"].setflags(write=False)
    if part["symmetry"] == "auto":
        part["symmetry"] = symmetry.order(part["outline_mm"])
    surface_file.resolve(values["pressure"], folder)
    job_checks.place_supports(values["pressure"], part["outline_mm"], shift)
    if cell["squeeze_height_mm"] is None:
        cell["squeeze_height_mm"] = tips_height_mm(part["height_mm"])
    job_checks.complete_gripper(values["gripper"])
    if document.get("doubt") and "encoder_mm" not in document["doubt"]:
        gripper = values["gripper"]
        most_mm = job_checks.doubt_mm(gripper["resolution_mm"], gripper["noise_mm"])
        values["doubt"]["encoder_mm"] = (-most_mm, most_mm)
    job_checks.refuse(job_checks.conflicts(values))
    if values["actions"]["pushes"] == "none":
        values["actions"]["pushes"] = None  # a job that states a default is the job without it
    sections = schema.SECTIONS.items()
    records = {name: values[name] and record(**values[name]) for name, record in sections}
    return Job(seed=values[""]["seed"], **records)


def _document(job: Job) -> dict[str, Any]:
    """Converts a job to a document of JSON types.

    If there are several hypotheses, only these have the sections [part], [pressure] and [friction].
    """
    document: dict[str, Any] = _plain(asdict(job))
    if job.foreign:
        document[hypotheses.FOREIGN] = document.pop("foreign")
    if job.hypothesis:
        for section in hypotheses.SECTIONS:
            del document[section]
    return document


def _plain(value: Any) -> Any:
    """Converts a value to JSON types, without the keys whose value is None."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        return [_plain(item) for item in value]
    return value.tolist() if isinstance(value, np.ndarray) else value
