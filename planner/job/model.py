"""The job file: everything a plan depends on, checked once, then frozen.

A job is TOML for people (`load`, `parse`) and canonical JSON for the table (`Job.canonical`,
`from_canonical`): the same keys, with every default written out, the symmetry resolved, and the outline
counter-clockwise about its centroid. The text is exact, so its digest names the job. Types, ranges and
defaults stand in `planner.job.schema`.
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
from planner.job import checks as job_checks
from planner.job import documents, surface_file
from planner.job.schema import changed, read_document
from planner.part import symmetry
from planner.part.outline import Outline
from planner.part.pressure import Pressure


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The part on the table.

    Attributes:
        name: for people.
        outline_mm: (N, 2) vertices, counter-clockwise, area centroid at the origin, read-only.
        symmetry: rotational order n; turns by 2 pi / n look the same, 1 = none.
        height_mm: its thickness, from the table to its top where the fingers close; None: not stated.
    """

    name: str
    outline_mm: Outline
    symmetry: int
    height_mm: float | None


@dataclass(frozen=True, slots=True)
class Friction:
    """Coefficient of friction between finger and part.

    Attributes:
        finger_part_min: lower bound; friction is uniform between the two.
        finger_part_max: upper bound.
        doubt: share of the plan's particles whose friction lies outside the bounds, so that a part which does
            not keep to them ends in an honest leaf.
    """

    finger_part_min: float
    finger_part_max: float
    doubt: float


@dataclass(frozen=True, slots=True)
class Gripper:
    """A parallel-jaw gripper.

    Attributes:
        model: name of the device.
        finger_length_mm: extent of a finger along x of the hand frame.
        finger_width_mm: extent along y, the closing direction.
        opening_mm: distance of the inner faces, jaws fully open.
        count_open: encoder reading, jaws fully open.
        count_closed: encoder reading, jaws fully closed.
        encoder_noise_mm: standard deviation of a measured width, before rounding to counts.
        speed_mm_s: rate at which the opening closes; each finger moves at half of it.
        force_n: grip force.
        upper_finger_share: share of the closing motion that the finger at +y makes; 0.5 = both alike, 1 = the
            other one sticks.
    """

    model: str
    finger_length_mm: float
    finger_width_mm: float
    opening_mm: float
    count_open: int
    count_closed: int
    encoder_noise_mm: float
    speed_mm_s: float
    force_n: float
    upper_finger_share: float


@dataclass(frozen=True, slots=True)
class Release:
    """What the part does when the jaws open: normal in each coordinate, after a squeeze that held it.

    Attributes:
        shift_mm: standard deviation of x and of y.
        turn_deg: standard deviation of the angle.
    """

    shift_mm: float
    turn_deg: float


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Where the part may lie before the first squeeze, about the origin of the world.

    Attributes:
        radius_mm: the centroid is uniform in this disc.
        orientation_halfwidth_deg: the orientation is uniform within plus or minus this; 180 = unknown.
    """

    radius_mm: float
    orientation_halfwidth_deg: float

    @property
    def orientation(self) -> str:
        """Say "unknown" if the part may lie at any angle, else "bounded"."""
        return "unknown" if self.orientation_halfwidth_deg >= 180.0 else "bounded"


@dataclass(frozen=True, slots=True, eq=False)
class Actions:
    """The hand placements to choose from: each angle at each centre, and what a belief suggests.

    Attributes:
        angles_deg: angles of the hand's x axis in the world.
        centers_mm: (K, 2) positions of the hand in the world, read-only.
        proposals: "belief": every node also considers placements relative to its own belief; or "none".
        openings_mm: openings to descend with; the least that stays clear is taken. Empty: fully open.
        forces_n: grip forces; unstable squeezes take the least. Empty: the gripper's own.
    """

    angles_deg: tuple[float, ...]
    centers_mm: Array
    proposals: str
    openings_mm: tuple[float, ...]
    forces_n: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Goal:
    """When a part counts as located.

    Attributes:
        kind: "pose": sqrt(dx^2 + dy^2) + rho dtheta < distance (paper eq. 9); "tolerances": x, y and theta
            each within its own (paper, VII); "modes": the pose is one of at most `modes`; "orientation":
            theta within its tolerance, wherever the part lies. Angles are taken under the part's symmetry.
        distance_mm: bound on the metric, for "pose" and "modes".
        confidence: probability with which a leaf must keep the bound.
        tolerance_mm: bounds on x and y, for "tolerances".
        tolerance_deg: bound on theta, for "tolerances" and "orientation".
        modes: how many poses a leaf may leave open, for "modes".
        stress_trials: parts squeezed in each of some worlds a little off the planned one, to find leaves that
            would be wrong there; 0 plans for the stated world alone.
        crash_share: share of the parts that may lie under an open finger coming down, where no placement is
            clear of all of them: an uncertainty wider than the jaws open.
    """

    kind: str
    distance_mm: float
    confidence: float
    tolerance_mm: tuple[float, float]
    tolerance_deg: float
    modes: int
    stress_trials: int
    crash_share: float


@dataclass(frozen=True, slots=True)
class Search:
    """How the tree is searched.

    Attributes:
        method: "closed-loop"; or, for comparison, the paper's: "paper" (Algorithms 1 to 3), "paper-sequence"
            (the whole open-loop sequence before branching) and "sensorless" (no branching at all).
        model: what the look-ahead squeezes with: "simulation", the learned "kcde", or "auto".
        rollouts: squeezes that the learned model is trained on.
        depth: squeezes to look ahead.
        squeeze_cost: probability of success that one more squeeze must gain.
        second_cost: the same for a second of cell time.
        stability_cost: the same for an outcome that hangs on an unstable equilibrium.
        particles: size of the belief that the tree is grown with.
        search_particles: size of the belief that looking ahead is done with.
        max_depth: longest path of the tree, squeezes.
    """

    method: str
    model: str
    rollouts: int
    depth: int
    squeeze_cost: float
    second_cost: float
    stability_cost: float
    particles: int
    search_particles: int
    max_depth: int


@dataclass(frozen=True, slots=True)
class Cell:
    """Limits of the cell that the runtime holds.

    Attributes:
        work_area_mm: ((x_min, y_min), (x_max, y_max)) that the hand may be placed in, world frame.
        retreat_height_mm: height of the finger tips between squeezes.
        squeeze_height_mm: height of the finger tips while squeezing.
        arm_speed_mm_s: speed of the arm.
        max_force_n: largest grip force the cell allows.
        max_speed_mm_s: largest closing speed the cell allows.
    """

    work_area_mm: tuple[tuple[float, float], tuple[float, float]]
    retreat_height_mm: float
    squeeze_height_mm: float
    arm_speed_mm_s: float
    max_force_n: float
    max_speed_mm_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Delivery:
    """What becomes of a localised part; `runtime.execution.delivery` reads it from the table's embedded job.

    Attributes:
        drop_mm: (2,) where the origin of the part's frame goes, world frame, read-only.
        drop_angle_deg: the part's angle there.
        grasp_mm: (2,) the hand's centre in the part's frame, read-only.
        grasp_angle_deg: the hand's angle there.
        width_mm: what the fingers then have to read; None: anything but nothing.
        width_tolerance_mm: how far off that they may read.
        area_mm: (4,) x min, y min, x max, y max of the hand while it carries, read-only; None: the work area.
    """

    drop_mm: Array
    drop_angle_deg: float
    grasp_mm: Array
    grasp_angle_deg: float
    width_mm: float | None
    width_tolerance_mm: float
    area_mm: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A checked job. Two jobs are equal if their canonical texts are."""

    seed: int
    part: Part
    pressure: Pressure
    friction: Friction
    gripper: Gripper
    release: Release
    uncertainty: Uncertainty
    actions: Actions
    goal: Goal
    search: Search
    cell: Cell
    delivery: Delivery | None = None

    def canonical(self) -> str:
        """Return the job as canonical JSON: keys sorted, no spaces, floats exact (shortest repr)."""
        return json.dumps(_plain(asdict(self)), sort_keys=True, separators=(",", ":"), allow_nan=False)

    def digest(self) -> bytes:
        """Return the SHA-256 of the canonical text, 32 bytes."""
        return hashlib.sha256(self.canonical().encode()).digest()

    def replaced(self, where: str = "the changed job", /, **changes: Any) -> Job:
        """Return a copy with other values, checked as in a file: `job.replaced(goal={"modes": 2}, seed=4)`.

        Args:
            where: what an error names as the place.
            changes: for each section, keys and values as a job file states them; for `seed` its value.
                Another `pressure.kind` drops the keys that only the old one takes.

        Raises:
            JobError: as `parse`.
        """
        document = changed(_plain(asdict(self)), _plain(changes), where)
        drawn = "outline_mm" in changes.get("part", ()) or "surface_file" in changes.get("pressure", ())
        return of_document(document, where, drawn)

    def __eq__(self, other: object) -> bool:
        return self.canonical() == other.canonical() if isinstance(other, Job) else NotImplemented

    def __hash__(self) -> int:
        return hash(self.canonical())


def load(path: str | Path, changes: Mapping[str, Any] | None = None) -> Job:
    """Read a job file.

    Args:
        path: a TOML file in UTF-8.
        changes: as `parse`.

    Raises:
        InputFileError: the file is missing, unreadable, a directory or not UTF-8.
        JobError: as `parse`.
    """
    return parse(documents.read(path), str(path), changes)


def files(path: str | Path) -> list[Path]:
    """The files that `load` reads: the job file, and what it names.

    Raises:
        JobError: as `load`.
    """
    document = documents.from_toml(documents.read(path), str(path))
    pressure = document.get("pressure")
    named = pressure.get("surface_file") if isinstance(pressure, dict) else None
    return [Path(path), *([Path(path).parent / named] if isinstance(named, str) else [])]


def parse(text: str, where: str = "job", changes: Mapping[str, Any] | None = None) -> Job:
    """Parse a job from TOML text.

    Args:
        text: the file's content.
        where: the file's name, for errors.
        changes: values that take the place of the file's, as `Job.replaced` takes them.

    Raises:
        TomlError: not valid TOML; line and column are attributes.
        KeyNameError: an unknown or missing key or section.
        ValueRangeError: a value of the wrong type, out of range, or in conflict with another.
        OutlineError: the outline is not a simple polygon.
        FitError: the part does not pass between the open fingers in any orientation.
    """
    return of_document(changed(documents.from_toml(text, where), changes or {}, where), where, drawn=True)


def from_canonical(text: str, where: str = "job text") -> Job:
    """Read a job back from its canonical text, exactly: `from_canonical(job.canonical()) == job`.

    Raises:
        TomlError: not valid JSON.
        JobError: as `parse`.
    """
    return of_document(documents.from_json(text, where), where, drawn=False)


def of_document(document: dict[str, Any], where: str, drawn: bool) -> Job:
    """Check a document and freeze it; only an outline as drawn is moved to its centroid.

    Raises:
        JobError: as `parse`.
    """
    values = read_document(document, where)
    part = values["part"]
    part["outline_mm"], shift = job_checks.place_outline(part["outline_mm"], where, drawn)
    if part["symmetry"] == "auto":
        part["symmetry"] = symmetry.order(part["outline_mm"])
    surface_file.resolve(values["pressure"], where, drawn)
    job_checks.place_supports(values["pressure"], part["outline_mm"], shift, where)
    job_checks.place_tips(part["height_mm"], values["cell"])
    job_checks.check_conflicts(values, where)
    actions, cell = values["actions"], values["cell"]
    for key in ("angles_deg", "openings_mm", "forces_n"):
        actions[key] = tuple(actions[key].tolist())
    values["goal"]["tolerance_mm"] = tuple(values["goal"]["tolerance_mm"].tolist())
    cell["work_area_mm"] = tuple(map(tuple, cell["work_area_mm"].tolist()))
    return Job(
        seed=values[""]["seed"],
        part=Part(**part),
        pressure=Pressure(**values["pressure"]),
        friction=Friction(**values["friction"]),
        gripper=Gripper(**values["gripper"]),
        release=Release(**values["release"]),
        uncertainty=Uncertainty(**values["uncertainty"]),
        actions=Actions(**actions),
        goal=Goal(**values["goal"]),
        search=Search(**values["search"]),
        cell=Cell(**cell),
        delivery=None if values["delivery"] is None else Delivery(**values["delivery"]),
    )


def _plain(value: Any) -> Any:
    """Return a value as JSON types; keys that are None are not written."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items() if item is not None}
    return value.tolist() if isinstance(value, np.ndarray) else value
