"""What a simulated cell starts from: part and world, loaded by name.

The one module that reaches planner and runtime, and only by dotted names: the drivers know neither.
"""

import importlib
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

Pose2 = tuple[float, float, float]  # mm, mm, rad

DEFAULT_WORLD = "planner.world:make"
REHEARSAL = "runtime.devices.rehearsal:make"
REHEARSAL_RADIUS_MM = 10.0  # a rehearsal's part lies somewhere; its world does not look where


class CellError(Exception):
    """The simulated cell cannot start; `exit_code` is what grasp-cell returns."""

    exit_code = 31


class CellFileError(CellError):
    """An input file is missing or unreadable."""

    exit_code = 3


class World(Protocol):
    """The physics of one squeeze; true width, without the encoder's noise."""

    def squeeze(self, pose_hand: Pose2) -> tuple[Pose2, float, str]:
        """Part pose in the hand frame -> its pose afterwards, the width in mm, and a status."""


class Geometry(NamedTuple):
    """What the cell itself needs to know of a job."""

    opening_mm: float
    count_open: int
    count_closed: int
    encoder_noise_mm: float
    squeeze_height_mm: float
    retreat_height_mm: float
    radius_mm: float
    halfwidth_rad: float

    @property
    def reach_mm(self) -> float:
        """Hand height at and below which the fingers meet the part: half way to the retreat height."""
        return (self.squeeze_height_mm + self.retreat_height_mm) / 2.0


class Setting(NamedTuple):
    """Everything a scene starts from: `subject` is the job, or the table for a rehearsal."""

    subject: Any
    geometry: Geometry
    world: str
    factory: Callable[[Any, int], World]

    def make_world(self, seed: int) -> World:
        """The world of a seed.

        Raises:
            CellError: the factory fails, or what it returns cannot squeeze.
        """
        try:
            made = self.factory(self.subject, seed)
        except Exception as error:  # a factory is what somebody else wrote
            kind = type(error).__name__
            raise CellError(f"world {self.world}: called with job and seed: {kind}: {error}") from error
        if not callable(getattr(made, "squeeze", None)):
            raise CellError(f"world {self.world}: what it returns has no method squeeze(pose_hand)")
        return made

    @property
    def truthful(self) -> bool:
        """Whether the world knows where the part really is."""
        return self.world != REHEARSAL


def load(tree: Path | None, job: Path | None, world: str | None) -> Setting:
    """Read table or job, and find the world.

    Args:
        tree: a compiled table; its embedded job is used.
        job: a job file, if there is no table.
        world: `module:factory`; none: the planner's, or a rehearsal where the planner is not installed.

    Raises:
        CellError: a file is missing, or the world cannot be had; errors of table and job pass as they are.
    """
    path = tree or job
    if path is None or not path.is_file():
        raise CellFileError(f"{path}: no such file; give a compiled table (--tree) or a job file (--job)")
    if world is None:
        world = DEFAULT_WORLD if _installed(DEFAULT_WORLD) else REHEARSAL
    factory = find_factory(world)
    if tree is None:
        subject = _module("planner.job.model").load(path)
        return Setting(subject, job_geometry(subject), world, factory)
    table = _module("runtime.table").load(tree).table
    if world == REHEARSAL:
        return Setting(table, table_geometry(table), world, factory)
    if table.job is None:
        raise CellError(f"{tree}: the table carries no job; give the job file (--job) or --world {REHEARSAL}")
    subject = _module("planner.job.model").from_canonical(table.job)
    return Setting(subject, job_geometry(subject), world, factory)


def find_factory(world: str) -> Callable[[Any, int], World]:
    """The factory a dotted path names.

    Raises:
        CellError: it is no such path, or nothing callable is there.
    """
    name, colon, attribute = world.partition(":")
    if not (colon and name and attribute.isidentifier()):
        raise CellError(
            f"world {world!r} is not understood; write it as module:factory, e.g. {DEFAULT_WORLD}"
        )
    factory = getattr(_module(name), attribute, None)
    if not callable(factory):
        raise CellError(f"world {world}: {name} has no function {attribute}")
    found: Callable[[Any, int], World] = factory
    return found


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except Exception as error:  # importing runs what somebody else wrote
        hint = "; install squeezetree[planner]" if name.startswith("planner") else ""
        raise CellError(f"module {name} cannot be imported ({error}){hint}") from error


def _installed(world: str) -> bool:
    try:
        find_factory(world)
    except CellError:
        return False
    return True


def job_geometry(job: Any) -> Geometry:
    """What the cell needs, from a parsed job."""
    gripper, cell, uncertainty = job.gripper, job.cell, job.uncertainty
    return Geometry(
        gripper.opening_mm,
        gripper.count_open,
        gripper.count_closed,
        gripper.encoder_noise_mm,
        cell.squeeze_height_mm,
        cell.retreat_height_mm,
        uncertainty.radius_mm,
        math.radians(uncertainty.orientation_halfwidth_deg),
    )


def table_geometry(table: Any) -> Geometry:
    """What the cell needs, from a table's header."""
    gripper, limits = table.gripper, table.limits
    return Geometry(
        gripper.opening_um / 1000.0,
        gripper.count_open,
        gripper.count_closed,
        gripper.encoder_noise_um / 1000.0,
        limits.squeeze_height_um / 1000.0,
        limits.retreat_height_um / 1000.0,
        REHEARSAL_RADIUS_MM,
        math.pi,
    )


def warm_up(setting: Setting, seed: int) -> None:
    """Squeeze once in a world of its own, so that kernels compile before anything waits for an answer."""
    setting.make_world(seed).squeeze((0.0, 0.0, 0.0))
