"""What a simulated cell starts from: part and world.

The planner may be missing, so its job reader is imported when a job is read; the drivers do not know it.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from drivers.planar import Pose2
from drivers.ports import TURN_RADIUS_MM, GripperProfile
from runtime import table as tables
from runtime.shell.errors import InputError, UsageError
from runtime.shell.worlds import DEFAULT_WORLD, WorldError, find_factory, make_world

REHEARSAL = "runtime.devices.rehearsal:make"
REHEARSAL_RADIUS_MM = 10.0  # a rehearsal's part lies somewhere; its world does not look where


class World(Protocol):
    """The physics of one squeeze; true width, without the encoder's noise."""

    def squeeze(self, pose_hand: Pose2) -> tuple[Pose2, float, str]:
        """Part pose in the hand frame -> its pose afterwards, the width in mm, and a status."""


class Geometry(NamedTuple):
    """What the cell itself needs to know of a job."""

    gripper: GripperProfile
    squeeze_height_mm: float
    retreat_height_mm: float
    radius_mm: float
    halfwidth_rad: float
    height_mm: float | None = None  # of the part
    acceleration_mm_s2: float | None = None  # of the arm, None: it needs no time for that
    turn_radius_mm: float = TURN_RADIUS_MM  # at which a turn has this acceleration

    @property
    def opening_mm(self) -> float:
        """Width of the jaws fully open."""
        return self.gripper.stroke_um / 1000.0

    @property
    def reach_mm(self) -> float:
        """Hand height at and below which open fingers meet the part: its own, else as for closing ones."""
        return self.closing_mm if self.height_mm is None else self.height_mm

    @property
    def closing_mm(self) -> float:
        """Hand height at and below which fingers that came down meet the part: half way to the retreat.

        That is above the part: a hand whose tips move on an arc rises as they close, and these are straight.
        """
        return (self.squeeze_height_mm + self.retreat_height_mm) / 2.0


class Block(NamedTuple):
    """A square block that is held fast, its sides along the axes."""

    width_mm: float
    x_mm: float = 0.0
    y_mm: float = 0.0


class Setting(NamedTuple):
    """Everything a scene starts from: `subject` is the job, or the table for a rehearsal."""

    subject: Any
    geometry: Geometry
    world: str
    factory: Callable[[Any, int], World]
    middle_mm: float = 0.0  # how far off the hand's middle the fingers meet, along its y
    block: Block | None = None  # what stands on the table instead of parts
    # The share and the job of each part, where there are several.
    parts: tuple[tuple[float, Any], ...] = ()
    pushing: bool = False  # whether the table that will run here pushes parts

    def make_worlds(self, seed: int) -> list[World]:
        """A world for each part; UsageError where the factory fails or returns what cannot squeeze."""
        subjects = [subject for _, subject in self.parts] or [self.subject]
        return [self._make_world(subject, seed + number) for number, subject in enumerate(subjects)]

    def _make_world(self, subject: Any, seed: int) -> World:
        try:
            world: World = make_world(self.factory, subject, seed)
        except WorldError as error:
            raise UsageError(f"world {self.world}: {error}") from error
        if self.pushing and self.truthful and not hasattr(world, "push"):
            raise UsageError(f"world {self.world} has no push() and the table pushes; name another")
        return world

    @property
    def truthful(self) -> bool:
        """Whether the world knows where the part really is."""
        return self.world != REHEARSAL


def load(tree: Path | None, job: Path | None, world: str | None) -> Setting:
    """Read table or job, and find the world.

    The world is `module:factory`; none: the planner's, or a rehearsal where the planner is not installed.
    UsageError where the world cannot be had, InputError where a file cannot.
    """
    path = tree or job
    if path is None or not path.is_file():
        raise InputError(f"{path}: no such file; give a table (--tree) or a job file (--job)")
    world, factory = _world(world)
    if tree is None:
        return _setting_of(_planner_job().load(path), world, factory)
    table = tables.load(tree).table
    pushing = table.pushing is not None
    if world == REHEARSAL:
        return Setting(table, table_geometry(table), world, factory, pushing=pushing)
    if table.job is None:
        raise UsageError(
            f"{tree}: the table carries no job; give the job file (--job) or --world {REHEARSAL}"
        )
    setting = _setting_of(_planner_job().from_canonical(table.job), world, factory)
    return setting._replace(pushing=pushing)


def _setting_of(job: Any, world: str, factory: Callable[[Any, int], World]) -> Setting:
    parts = tuple(zip(job.shares, job.alone, strict=True)) if job.hypothesis else ()
    return Setting(job, job_geometry(job), world, factory, parts=parts)


def _world(name: str | None) -> tuple[str, Callable[[Any, int], Any]]:
    """Name and factory of a world; of the rehearsal where none is named and the planner's is missing."""
    try:
        return name or DEFAULT_WORLD, find_factory(name or DEFAULT_WORLD)
    except WorldError as error:
        if name is None:
            return REHEARSAL, find_factory(REHEARSAL)
        hint = "; install squeezetree[planner]" if name.startswith("planner") else ""
        raise UsageError(f"world {name}: {error}{hint}") from error


def _planner_job() -> Any:
    try:
        return import_module("planner.job.model")
    except ImportError as error:
        raise UsageError(f"a job cannot be read ({error}); install squeezetree[planner]") from error


def job_geometry(job: Any) -> Geometry:
    """What the cell needs, from a parsed job."""
    gripper, cell, uncertainty = job.gripper, job.cell, job.uncertainty
    timing = import_module("planner.job.cell").timing_of(job)
    return Geometry(
        gripper.profile,
        cell.squeeze_height_mm,
        cell.retreat_height_mm,
        uncertainty.radius_mm,
        math.radians(uncertainty.orientation_halfwidth_deg),
        _height_mm(job),
        timing.arm_acceleration_mm_s2,
        timing.turn_radius_mm,
    )


def _height_mm(job: Any) -> float | None:
    """Of the highest of the parts that may lie there; None where one's is not known."""
    heights = [alone.part.height_mm for alone in job.alone]
    return None if None in heights else max(heights)


def table_geometry(table: tables.Table) -> Geometry:
    """What the cell needs, from a table's header."""
    limits = table.limits
    timing = tables.Schedule.of(table, tables.job_of(table)).timing
    regrasp_mm = timing.regrasp_mm
    return Geometry(
        table.gripper.profile,
        limits.squeeze_height_um / 1000.0,
        limits.retreat_height_um / 1000.0,
        REHEARSAL_RADIUS_MM,
        math.pi,
        height_mm=None if regrasp_mm == timing.retreat_mm else regrasp_mm - tables.ABOVE_MM,
        acceleration_mm_s2=timing.arm_acceleration_mm_s2,
        turn_radius_mm=timing.turn_radius_mm,
    )


def warm_up(setting: Setting, seed: int) -> None:
    """Act once in a world of its own, so that kernels compile before anything waits for an answer.

    Raises:
        UsageError: the world fails.
    """
    for world in setting.make_worlds(seed):
        with _telling(setting.world, "squeeze"):
            world.squeeze((0.0, 0.0, 0.0))
        push = getattr(world, "push", None)
        if setting.pushing and push is not None:
            with _telling(setting.world, "push"):
                push((setting.geometry.opening_mm, 0.0, 0.0), 0.0, 1.0)


@contextmanager
def _telling(world: str, method: str) -> Iterator[None]:
    """What a world from elsewhere raises, as a sentence that names it."""
    try:
        yield
    except Exception as error:
        raise UsageError(
            f"world {world}: {method}() failed: {type(error).__name__}: {error}"
        ) from error
