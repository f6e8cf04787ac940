"""The command `grasp-doctor`: checks a cell before it runs, and states remedies; moves nothing."""

import argparse
import json
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from drivers.ports import Drivers
from runtime.commands import checks as doctor
from runtime.commands.arguments import MANUAL, SIMULATED, address
from runtime.commands.cell import REHEARSAL
from runtime.commands.checks import Finding, Verdict
from runtime.commands.ur_checks import check_controllers
from runtime.devices.cell_process import CellProcess
from runtime.devices.clock import SystemClock
from runtime.devices.lock import PortLock
from runtime.execution import calibration
from runtime.shell.command import Parser, say
from runtime.shell.errors import CheckFailedError, ExpectedError, UsageError
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.table import PROFILES, Calibration, GripperProfile, Table, load, profile_of

EPILOG = """\
examples:
  grasp-doctor --port /dev/ttyUSB0 --arm tcp://192.168.125.1:5000 --tree T.msgpack
  grasp-doctor --port /dev/ttyUSB0 --json
  grasp-doctor --port sim --tree T.msgpack

""" + epilog(ExitCode.INPUT, ExitCode.CHECK_FAILED, ExitCode.UNREACHABLE, ExitCode.STOPPED)
MARKS = {Verdict.GOOD: "ok  ", Verdict.WARNING: "WARN", Verdict.BAD: "BAD "}


def parser() -> Parser:
    """Builds the argument parser of `grasp-doctor`."""
    text = "Check a cell before it runs; moves nothing."
    built = Parser(prog="grasp-doctor", description=text, epilog=EPILOG)
    add = built.add_argument
    text = "the gripper, as for grasp-runtime; sim with --tree"
    add("--port", type=address, required=True, help=text)
    add("--arm", type=address, help="the arm, as for grasp-runtime")
    add("--tree", type=Path, metavar="T", help="the table that is to run")
    text = (
        f"the gripper's model, without --tree: {', '.join(PROFILES)}, or that of another driver (default: "
        "the usual model of the port's make)"
    )
    add("--gripper", metavar="MODEL", help=text)
    add("--calibration", type=Path, metavar="F", help="the gripper's calibration")
    built.add_common()
    return built


def run(arguments: argparse.Namespace, drivers: Drivers) -> int:
    """Runs the checks, and prints a line for each finding, or all findings as one JSON object; returns 0.

    Args:
        arguments: the parsed command line.
        drivers: opens the devices.

    Raises:
        CheckFailedError: at least one finding is bad.
    """
    if arguments.tree is not None and arguments.gripper is not None:
        raise UsageError("--gripper is for a check without a table; leave it out, or --tree")
    table = None if arguments.tree is None else load(arguments.tree).table
    profile = _profile(arguments, table)
    path = arguments.calibration
    known = None if path is None else calibration.load(path).calibration
    results: list[Finding] = []
    with _devices(arguments) as (port, arm):
        for finding in findings(port, arm, table, profile, known, drivers):
            results.append(finding)
            if not arguments.json:
                say(_as_line(finding))
    bad = sum(finding.verdict is Verdict.BAD for finding in results)
    if arguments.json:
        say(json.dumps({"fit": not bad, "findings": [_as_object(finding) for finding in results]}))
    if bad:
        raise CheckFailedError(
            f"{bad} thing{'s' if bad > 1 else ''} to put right before this cell runs"
        )
    return 0


@contextmanager
def _devices(arguments: argparse.Namespace) -> Iterator[tuple[str, str | None]]:
    """Context that yields the addresses of gripper and arm; the arm's address is None if there is no arm.

    For `--port sim`, a simulated cell runs during the context.
    """
    if arguments.port != SIMULATED:
        yield arguments.port, arguments.arm
        return
    if arguments.tree is None:
        raise UsageError(
            "--port sim needs --tree T: a simulated cell has the part and gripper of a table"
        )
    with CellProcess(arguments.tree, world=REHEARSAL, seed=0, time_scale=1.0) as cell:
        yield cell.endpoints.gripper, arguments.arm or cell.endpoints.arm


def findings(
    port: str,
    arm_url: str | None,
    table: Table | None,
    profile: GripperProfile | None,
    known: calibration.GripperCalibration | None,
    drivers: Drivers,
) -> Iterator[Finding]:
    """Runs all checks and yields their findings; a check comes after the checks on which it depends.

    Args:
        port: address of the gripper.
        arm_url: address of the arm; None: no arm.
        table: the table that is to run; None: none.
        profile: the gripper's expected profile; None: the driver's default.
        known: the gripper's calibration; None: nominal widths.
        drivers: opens the devices.
    """
    if table is not None:
        of_table = table.gripper.profile
        yield from doctor.check_table(table, known.of(of_table) if known else Calibration(of_table))
    elif known is not None and profile is not None:
        known.of(profile)  # refuses a calibration of other jaws
    yield from check_controllers(filter(None, (port, arm_url)))
    yield from _gripper_findings(port, profile, drivers)
    if arm_url is not None:
        try:
            with closing(drivers.arm(arm_url, read_only=True)) as arm:
                yield from doctor.check_arm(arm, table)
        except OSError as error:
            page = "drivers/abb/README.md" if arm_url.startswith("tcp:") else "tools/docs/arms.md"
            remedy = f"Look at the controller's program and state; see {page}."
            yield doctor.failed("arm", error, remedy)


def _profile(arguments: argparse.Namespace, table: Table | None) -> GripperProfile | None:
    """The gripper's profile: that of the table, else that of the model which `--gripper` names.

    None if neither is given; the driver then has a default.
    """
    if table is not None:
        return table.gripper.profile
    return None if arguments.gripper is None else profile_of(arguments.gripper)


def _serial_port(port: str) -> str:
    """Extracts the path of a serial port from a gripper's address; "" if the address has none."""
    if port.startswith(("can:", MANUAL)):
        return ""
    _, is_url, rest = port.partition("?")[0].rpartition("://")
    return rest if not is_url or rest.startswith("/") else ""


def _gripper_findings(
    port: str, profile: GripperProfile | None, drivers: Drivers
) -> Iterator[Finding]:
    path = _serial_port(port)
    if path:
        for finding in doctor.check_port(path):
            yield finding
            if finding.verdict is Verdict.BAD:
                return
        yield from doctor.check_latency(path)
    failed = None
    try:
        with PortLock(port), closing(drivers.gripper(port, profile, read_only=True)) as gripper:
            yield from doctor.check_model(gripper)
            yield from doctor.check_gripper(gripper)
            yield from doctor.check_rate(gripper, SystemClock())
    except (OSError, ExpectedError) as error:
        failed = doctor.failed("gripper", error, "Check power, cable and address.")
    if failed is not None:
        yield failed
        if path == port:  # the address of a Robotiq gripper is only the path
            try:
                yield from doctor.check_silence(port, drivers.scan)
            except OSError as error:
                yield doctor.failed("port", error, "Check cable and adapter.")


def _as_line(finding: Finding) -> str:
    message = f"{MARKS[finding.verdict]} {finding.sentence}"
    return f"{message} -> {finding.remedy}" if finding.remedy else message


def _as_object(finding: Finding) -> dict[str, object]:
    verdict, sentence, remedy = finding
    return {"verdict": verdict.value, "sentence": sentence, "remedy": remedy or None}
