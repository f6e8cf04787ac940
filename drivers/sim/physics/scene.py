"""The setting of a simulated cell: part and world.

The planner may be missing, since drivers do not depend on it: its job reader is imported when a job is read.
"""

import math
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from drivers.planar import Pose2
from drivers.ports import TURN_RADIUS_MM, GripperProfile
from runtime import table as tables
from runtime.shell.errors import InputError, UsageError
from runtime.shell.worlds import DEFAULT_WORLD, WorldError, find_factory, make_world

REHEARSAL = "runtime.devices.rehearsal:make"
REHEARSAL_RADIUS_MM = 10.0  # a rehearsal's part has no pose; its world does not use it


class World(Protocol):
    """The physics of squeezes; widths are true, without the encoder's noise."""

    def squeeze(self, pose_hand: Pose2) -> tuple[Pose2, float, str]:
        """Squeezes a part that lies at a pose in the hand frame.

        Returns:
            Pose of the part afterwards, in the hand frame; width in mm; and a status.
        """


class Geometry(NamedTuple):
    """What a job or decision table states about gripper, heights, the part's pose and arm acceleration."""

    gripper: GripperProfile
    squeeze_height_mm: float
    retreat_height_mm: float
    radius_mm: float  # greatest distance of a new part from the origin
    halfwidth_rad: float  # greatest angle of a new part, to either side
    height_mm: float | None = None  # height of the part
    acceleration_mm_s2: float | None = None  # None: the arm reaches its speed at once
    turn_radius_mm: float = TURN_RADIUS_MM  # radius that converts an acceleration to a turn's

    @property
    def opening_mm(self) -> float:
        """Width of the jaws fully open."""
        return self.gripper.stroke_um / 1000.0

    @property
    def reach_mm(self) -> float:
        """Greatest hand height at which open fingers meet the part.

        It is the height of the part or, if that is unknown, `closing_mm`.
        """
        return self.closing_mm if self.height_mm is None else self.height_mm

    @property
    def closing_mm(self) -> float:
        """Greatest hand height at which closing fingers meet the part: half way from squeeze to retreat.

        The limit is higher than the part. The tips of some real grippers move on an arc, so the runtime
        raises the hand as they close. The simulated tips move straight, and still have to meet the part at
        that height.
        """
        return (self.squeeze_height_mm + self.retreat_height_mm) / 2.0


class Block(NamedTuple):
    """A fixed square block with its centre at (x, y) and its sides along the axes of the world."""

    width_mm: float
    x_mm: float = 0.0
    y_mm: float = 0.0


class Setting(NamedTuple):
    """What a simulated cell is made from: job, geometry and world.

    `subject` is the job or, for a rehearsal (a world that draws widths without physics), the decision
    table.
    """

    subject: Any
    geometry: Geometry
    world: str
    factory: Callable[[Any, int], World]
    # Offset of the point where the fingers meet from the hand's middle, along the hand's y.
    middle_mm: float = 0.0
    block: Block | None = None  # a fixed block instead of parts
    # Share and job of each part; empty: there is one part
    parts: tuple[tuple[float, Any], ...] = ()
    pushing: bool = False  # whether the table pushes parts

    def make_worlds(self, seed: int) -> list[World]:
        """Creates one world for each part that may lie on the table.

        Raises:
            UsageError: the factory fails, or a world lacks a method that the scene needs.
        """
        worlds: list[World] = []
        for subject in [subject for _, subject in self.parts] or [self.subject]:
            try:
                worlds.append(make_world(self.factory, subject, seed + len(worlds)))
            except WorldError as error:
                raise UsageError(f"world {self.world}: {error}") from error
        if self.pushing and self.truthful and not all(hasattr(each, "push") for each in worlds):
            raise UsageError(f"world {self.world} has no push() and the table pushes; name another")
        return worlds

    @property
    def truthful(self) -> bool:
        """Whether the world knows the true pose of the part."""
        return self.world != REHEARSAL


def load(tree: Path | None, job: Path | None, world: str | None) -> Setting:
    """Reads a decision table or a job file, and finds its world; returns the setting of a cell.

    Args:
        tree: file of the decision table; None: `job` is read.
        job: the job file.
        world: `module:factory`; None: the planner's world or, if the planner is missing, a rehearsal.

    Raises:
        UsageError: the world cannot be loaded, the planner is missing, or the table carries no job.
        InputError: the file cannot be read.
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
    """Finds the factory of a world; by default the planner's world, or a rehearsal if the planner is missing.

    Returns:
        Name and factory of the world.
    """
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
    """Creates the geometry that a parsed job states."""
    gripper, cell, uncertainty = job.gripper, job.cell, job.uncertainty
    timing = import_module("planner.job.cell").timing_of(job)
    heights = cell.squeeze_height_mm, cell.retreat_height_mm
    region = uncertainty.radius_mm, math.radians(uncertainty.orientation_halfwidth_deg)
    ramps = timing.arm_acceleration_mm_s2, timing.turn_radius_mm
    return Geometry(gripper.profile, *heights, *region, _height_mm(job), *ramps)


def _height_mm(job: Any) -> float | None:
    """Height of the highest part that may be on the table, mm; None if the height of a part is unknown."""
    heights = [alone.part.height_mm for alone in job.alone]
    return None if None in heights else max(heights)


def table_geometry(table: tables.Table) -> Geometry:
    """Creates the geometry of a rehearsal from a decision table; the region of the part's pose is fixed."""
    limits = table.limits
    timing = tables.Schedule.of(table, tables.job_of(table)).timing
    regrasp_mm = timing.regrasp_mm
    heights = limits.squeeze_height_um / 1000.0, limits.retreat_height_um / 1000.0
    region = REHEARSAL_RADIUS_MM, math.pi
    part_mm = None if regrasp_mm == timing.retreat_mm else regrasp_mm - tables.ABOVE_MM
    ramps = timing.arm_acceleration_mm_s2, timing.turn_radius_mm
    return Geometry(table.gripper.profile, *heights, *region, part_mm, *ramps)


def warm_up(setting: Setting, seed: int) -> None:
    """Compiles the kernels of the world, so that no client waits for that later.

    For each part that may lie on the table, it squeezes once in a new world and, if the decision table has
    pushes, pushes once.

    Raises:
        UsageError: the world fails.
    """
    for world in setting.make_worlds(seed):
        push = getattr(world, "push", None)
        method = "squeeze"
        try:
            world.squeeze((0.0, 0.0, 0.0))
            if setting.pushing and push is not None:
                method = "push"
                push((setting.geometry.opening_mm, 0.0, 0.0), 0.0, 1.0)
        except Exception as error:
            raise UsageError(
                f"world {setting.world}: {method}() failed: {type(error).__name__}: {error}"
            ) from error
