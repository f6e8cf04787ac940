"""Opens the devices of a run. For `--port sim`, starts a simulated cell first."""

import argparse
from contextlib import ExitStack
from importlib.util import find_spec
from math import inf
from typing import NamedTuple, cast

from drivers.ports import Arm, Drivers, Gripper, Report, Scene
from runtime.commands.arguments import MANUAL, SIMULATED, SIMULATED_CAMERA
from runtime.commands.recipe import Recipe
from runtime.devices.cell_process import CellProcess
from runtime.devices.clock import SystemClock
from runtime.devices.lock import PortLock
from runtime.execution.events import Console
from runtime.shell.worlds import DEFAULT_WORLD
from runtime.table import Table

REHEARSAL = "runtime.devices.rehearsal:make"
PLANNER_NEEDS = ("numpy", "scipy", "numba")


class Devices(NamedTuple):
    """The opened devices of a run."""

    gripper: Gripper
    arm: Arm
    scene: Scene | None  # brings parts and tells their true poses, in a simulated cell; else None
    camera: str = ""  # address of the camera of a simulated cell; "" without a camera
    clock: SystemClock | None = None  # the clock of a simulated cell in virtual time; else None


def connect(
    arguments: argparse.Namespace,
    recipe: Recipe,
    drivers: Drivers,
    stack: ExitStack,
    report: Report,
) -> Devices:
    """Connects to the devices of a run, real or simulated; nothing moves.

    Args:
        arguments: the parsed command line of `grasp-runtime`.
        recipe: its table states the gripper's model and the part of a simulated cell; its console receives
            notes about a simulated cell.
        drivers: opens the devices.
        stack: when it closes, the devices are closed.
        report: function that is called at each retry and failure on the gripper's link.

    Raises:
        ExpectedError: a lock is taken, the simulated cell does not start, or a driver fails.
    """
    table, console = recipe.loaded.table, recipe.console
    gripper_port, arm_url, scene_url, camera = arguments.port, arguments.arm, None, ""
    if arguments.port == SIMULATED:
        tree, world = arguments.trees[0], arguments.world or _default_world(table, console)
        if arguments.time_scale == inf:
            virtual = drivers.virtual(tree, world=world, seed=arguments.seed, report=report)
            console.note(f"simulated cell ({world}), in virtual time")
            clock = cast(SystemClock, virtual.clock)
            return Devices(virtual.gripper, virtual.arm, virtual.scene, clock=clock)
        process = CellProcess(
            tree,
            world=world,
            seed=arguments.seed,
            time_scale=arguments.time_scale,
            camera=SIMULATED_CAMERA in (arguments.audit or ""),
        )
        cell = stack.enter_context(process).endpoints
        gripper_port, arm_url, scene_url, camera = cell.gripper, cell.arm, cell.scene, cell.camera
        console.note(f"simulated cell ({cell.world}), {arguments.time_scale:g} times real time")
        if arguments.arm == MANUAL:
            arm_url = f"{MANUAL}+{cell.arm}"  # the simulated arm follows the person's hand
    for port in (gripper_port, arm_url):
        stack.enter_context(PortLock(port))
    only, scale = arguments.dry_run, arguments.time_scale
    gripper = drivers.gripper(
        gripper_port, table.gripper.profile, time_scale=scale, read_only=only, report=report
    )
    stack.callback(gripper.close)
    arm = drivers.arm(arm_url, time_scale=scale, read_only=only)
    stack.callback(arm.close)
    if scene_url is None:
        return Devices(gripper, arm, None)
    scene = drivers.scene(scene_url)
    stack.callback(scene.close)
    return Devices(gripper, arm, scene, camera)


def _default_world(table: Table, console: Console) -> str:
    """Chooses the world of a simulated cell; returns its name.

    The planner's world, which simulates contacts, needs the planner's packages and the job in the table. If
    any of these is missing, chooses the rehearsal, which draws widths from the table's statistics, and says
    so on the console.
    """
    missing = [name for name in PLANNER_NEEDS if find_spec(name) is None]
    if table.job is not None and not missing:
        return DEFAULT_WORLD
    reason = f"{missing[0]} is not installed" if missing else "the table carries no job"
    console.note(f"no contact world: {reason}; widths are drawn from the table's own statistics")
    return REHEARSAL
