"""The commands of the cell, wired to the drivers: `grasp-runtime`, `grasp-doctor` and `grasp-calibrate`.

The one module of the runtime that opens devices.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from drivers import connect
from drivers.ports import Arm, Gripper
from runtime.commands import options
from runtime.commands.options import SIMULATED, parser
from runtime.devices.audit import AuditProcess
from runtime.devices.cell_process import CellProcess
from runtime.devices.clock import SystemClock
from runtime.devices.lock import PortLock
from runtime.devices.ports import Scene
from runtime.errors import BrokenRunError, CalibrationError, StoppedError
from runtime.execution import carry, crash, dry_run, held, session
from runtime.execution.events import Console
from runtime.execution.executor import Cell, RunOptions
from runtime.execution.hand import check_arc
from runtime.execution.held import Held
from runtime.execution.safe_state import DECLARED
from runtime.execution.safety import check_table, ready_gripper
from runtime.journal.chain import Incidents, Journal, Report
from runtime.monitoring.console import Lines, Objects
from runtime.monitoring.monitor import Monitor
from runtime.shell import command, interrupts
from runtime.shell.command import Parser, say
from runtime.shell.interrupts import StopRequests
from runtime.table import PPM, Calibration, Table, TableFile, load, misfits

REHEARSAL = "runtime.devices.rehearsal:make"
CONTACT_WORLD = "planner.world:make"
PLANNER_NEEDS = ("numpy", "scipy", "numba", "planner.world")


class Devices(NamedTuple):
    """What a run talks to; a scene only where the cell is simulated."""

    gripper: Gripper
    arm: Arm
    scene: Scene | None
    camera: str = ""


def main(argv: Sequence[str] | None = None) -> int:
    """Run `grasp-runtime`.

    Args:
        argv: its arguments, without the program's name; None for the process's own.

    Returns:
        The exit code.
    """
    return guarded(parser(), argv, run)


def doctor(argv: Sequence[str] | None = None) -> int:
    """Run `grasp-doctor`; returns its exit code."""
    from runtime.commands import (
        doctor as doctor_command,
    )  # another command's modules are not loaded into a run

    return guarded(doctor_command.parser(), argv, lambda given: doctor_command.run(given, connect))


def calibrate(argv: Sequence[str] | None = None) -> int:
    """Run `grasp-calibrate`; returns its exit code."""
    from runtime.commands import calibrate as calibrate_command

    words = list(sys.argv[1:] if argv is None else argv)
    if next((word for word in words if not word.startswith("-")), "") in calibrate_command.OF_THE_AUDIT:
        from drivers.camera.commands import calibrate as of_the_audit

        return of_the_audit(words)

    return guarded(
        calibrate_command.parser(), argv, lambda given: calibrate_command.run(given, connect.gripper)
    )


def guarded(built: Parser, argv: Sequence[str] | None, body: Callable[[argparse.Namespace], int]) -> int:
    """Run a command of the cell, which hears one stop request; returns its exit code."""
    with StopRequests(last=argv is None):
        return command.run(built, argv, lambda arguments: stopped(body, arguments))


def stopped(body: Callable[[argparse.Namespace], int], arguments: argparse.Namespace) -> int:
    """Do what a command does, until a stop request ends it.

    Raises:
        StoppedError: it did.
    """
    try:
        with interrupts.stoppable():
            return body(arguments)
    except KeyboardInterrupt as request:
        request.args = ("stopped by the operator while no part was being squeezed",)
        raise StoppedError(command.told(request)) from None


def run(arguments: argparse.Namespace) -> int:
    """Execute a table as the parsed arguments say.

    Returns:
        The exit code of the parts.

    Raises:
        Exception: any error of ours or of a device; each carries its `exit_code`.
    """
    options.check_usage(arguments)
    loaded = load(arguments.tree)
    table = loaded.table
    check_table(table)
    measured = options.gripper_calibration(arguments)
    plan = options.plan_of(arguments, table, measured)
    console: Console = Objects(table, arguments.journal) if arguments.json else Lines(table)
    console.note(_headline(arguments.tree, table))
    _check_fit(table, plan)
    carry.check(plan.delivery, table)
    if arguments.check:
        return _check(arguments, table, plan, console)
    with ExitStack() as stack:
        if arguments.dry_run:
            return _dry_run(arguments, table, plan, console, stack)
        return _run(arguments, loaded, plan, console, stack)


def _run(
    arguments: argparse.Namespace, loaded: TableFile, plan: RunOptions, console: Console, stack: ExitStack
) -> int:
    clock = SystemClock(arguments.time_scale)
    table, data, _ = loaded
    header, policy = _header(arguments, plan), arguments.after_crash
    # First of all, since it may be refused; what runs below closes before it, and is watched until then.
    monitor = stack.enter_context(Monitor(console, loaded, arguments.tree, options.views(arguments)))
    journal = begun = None
    if os.path.lexists(arguments.journal):
        journal = stack.enter_context(Journal(arguments.journal, clock.stamp))
        within = {"now": clock.stamp(), "most_s": arguments.resume_within}
        try:
            begun = crash.look(journal, data, header, policy, console, **within)
        except BrokenRunError as error:
            if not arguments.put_down:
                raise
            console.note(str(error))
    incidents = Incidents()
    devices = _connect(arguments, table, console, stack, incidents.record)
    carry.check(plan.delivery, table, devices.arm)
    # A simulated gripper powers up in reset like a real one, and nothing real is between its fingers.
    activate = arguments.activate or arguments.port == SIMULATED
    # What would be refused later is refused now: a run that never was leaves no record, and no file.
    if begun is None or begun.part is None:
        holds = _holds(arguments, devices, plan, table, activate=activate)
        if arguments.put_down and holds is None:
            return _say_put_down(arguments, console, None)
    auditor = None
    if arguments.audit is not None:
        auditing = arguments.audit.replace(options.SIMULATED_CAMERA, devices.camera)
        auditor = stack.enter_context(AuditProcess(auditing, SystemClock()))
        auditor.check()
    journal = journal or stack.enter_context(Journal(arguments.journal, clock.stamp))
    cell = Cell(devices.gripper, devices.arm, clock, journal, auditor)
    monitor.ready()
    stack.enter_context(interrupts.whole())  # a run with a header has a last record, too
    crash.begin(journal, begun, data, header, policy)
    incidents.hand_over(journal)
    if arguments.put_down:
        return _say_put_down(arguments, console, session.put_down(table, cell, monitor, plan))
    tally = session.run_journalled(
        table,
        cell,
        devices.scene,
        monitor,
        count=arguments.count,
        activate=activate,
        options=plan,
        watch=monitor.phase,
        broken=begun,
    )
    monitor.summary(tally, arguments.journal)
    return tally.exit_code


def _holds(
    arguments: argparse.Namespace, devices: Devices, plan: RunOptions, table: Table, *, activate: bool
) -> Held | None:
    """What the fingers may hold before a run begins, if they may be moved all the same.

    Raises:
        GripperStateError: they may not: the gripper is not ready, or holds something.
    """
    state = devices.gripper.state()
    holds = held.look(state, _calibration(plan, table))
    if arguments.put_down and holds is None:
        return None
    if state.activated or arguments.put_down or not activate:
        ready_gripper(devices.gripper)
    if holds is not None and not (arguments.put_down or arguments.jaws_empty):
        raise holds.refusal(devices.arm.pose()[2], arguments.journal)
    return holds


def _say_put_down(arguments: argparse.Namespace, console: Console, told: Mapping[str, object] | None) -> int:
    if arguments.json:
        say(json.dumps({"put_down": told}))
    elif told is None:
        console.note("the fingers hold nothing; nothing was moved")
    else:
        console.note(
            f"put down at ({told['x_mm']:.2f}, {told['y_mm']:.2f}) mm, {told['width_mm']:.2f} mm between the "
            "fingers; the run ends here: look where it lies, then start again"
        )
    return 0


def _check_fit(table: Table, plan: RunOptions) -> None:
    calibration = _calibration(plan, table)
    problems = misfits(table, calibration)
    if problems:
        raise CalibrationError(problems[0])
    check_arc(plan.handling.arc, table.limits, calibration)


def _calibration(plan: RunOptions, table: Table) -> Calibration:
    return plan.handling.calibration or Calibration.linear(table.gripper)


def _check(arguments: argparse.Namespace, table: Table, plan: RunOptions, console: Console) -> int:
    """Tell that the table fits; look at the gripper where there is one. Nothing moves."""
    told: dict[str, object] = {"nodes": len(table.nodes), "gripper": None}
    calibration = _calibration(plan, table)
    origin = arguments.calibration or "the linear map"
    console.note(f"the table fits the gripper: {len(table.nodes)} nodes, 256 counts each, by {origin}")
    if plan.delivery is not None:
        console.note(
            "the part can be delivered from every leaf, as far as areas tell; --dry-run asks the arm"
        )
    if arguments.port is not None:
        gripper = connect.gripper(arguments.port, read_only=True)
        try:
            seen = gripper.state()
        finally:
            gripper.close()
        width_mm = calibration.width_um(seen.position_counts) / 1000
        console.note(f"the gripper stands at count {seen.position_counts}, which is {width_mm:.2f} mm")
        told["gripper"] = {"position_counts": seen.position_counts, "width_mm": width_mm}
    if arguments.json:
        say(json.dumps(told))
    return 0


def _dry_run(
    arguments: argparse.Namespace, table: Table, plan: RunOptions, console: Console, stack: ExitStack
) -> int:
    devices = _connect(arguments, table, console, stack, Incidents().record)
    told = dry_run.tell(table, devices.gripper, devices.arm, plan)
    if arguments.json:
        say(json.dumps({"told": told}))
    else:
        for sentence in told:
            console.note(sentence)
    console.note("dry run: nothing was written to the gripper, and nothing but questions to the arm")
    return 0


def _connect(
    arguments: argparse.Namespace, table: Table, console: Console, stack: ExitStack, report: Report
) -> Devices:
    """Connect to the devices; for a simulated cell start it first and then talk to it as to hardware."""
    gripper_port, arm_url, scene_url, camera = arguments.port, arguments.arm, None, ""
    if arguments.port == SIMULATED:
        world = arguments.world or _default_world(table, console)
        process = CellProcess(
            arguments.tree,
            world=world,
            seed=arguments.seed,
            time_scale=arguments.time_scale,
            camera=options.SIMULATED_CAMERA in (arguments.audit or ""),
        )
        cell = stack.enter_context(process).endpoints
        gripper_port, arm_url, scene_url, camera = cell.gripper, cell.arm, cell.scene, cell.camera
        console.note(f"simulated cell ({cell.world}), {arguments.time_scale:g} times as fast as life")
    for port in (gripper_port, arm_url):
        stack.enter_context(PortLock(port))
    only, scale = arguments.dry_run, arguments.time_scale
    gripper = connect.gripper(gripper_port, time_scale=scale, read_only=only, report=report)
    stack.callback(gripper.close)
    arm = connect.arm(arm_url, time_scale=scale, read_only=only)
    stack.callback(arm.close)
    if scene_url is None:
        return Devices(gripper, arm, None)
    scene = connect.scene(scene_url)
    stack.callback(scene.close)
    return Devices(gripper, arm, scene, camera)


def _default_world(table: Table, console: Console) -> str:
    """The contact world if it can run here, else the rehearsal, with a line that says so."""
    missing = [name for name in PLANNER_NEEDS if not _is_installed(name)]
    if table.job is not None and not missing:
        return CONTACT_WORLD
    reason = f"{missing[0]} is not installed" if missing else "the table carries no job"
    console.note(f"no contact world: {reason}; widths are drawn from the table's own statistics")
    return REHEARSAL


def _is_installed(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def _headline(path: Path, table: Table) -> str:
    told = f"table {path}: {len(table.nodes)} nodes, {len(table.leaves)} leaves"
    predicted = table.predicted
    if predicted.trials:
        told += f", predicted success {predicted.success_ppm / PPM:.4f}"
        told += f", {predicted.mean_squeezes_ppm / PPM:.2f} squeezes a part"
    return told


def _header(arguments: argparse.Namespace, plan: RunOptions) -> dict[str, object]:
    on_reject, on_unresolved = plan.policy.texts()
    measured = plan.handling.calibration
    return {
        "table": str(arguments.tree),
        "port": arguments.port,
        "arm": arguments.arm,
        "count": arguments.count,
        "time_scale": arguments.time_scale,
        "seed": arguments.seed if arguments.port == SIMULATED else None,
        "on_reject": on_reject,
        "on_unresolved": on_unresolved,
        "after_crash": arguments.after_crash,
        "force": arguments.force,
        "tips": None if plan.handling.arc is None else str(plan.handling.arc),
        "calibration": None if arguments.calibration is None else str(arguments.calibration),
        "widths_um": None if measured is None else list(measured.widths_um),
        "declared_safe_state": DECLARED,
    }


if __name__ == "__main__":
    sys.exit(main())
