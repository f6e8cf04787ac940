"""Checks the arguments of `grasp-runtime` for contradictions, and derives the options of a run from them."""

import argparse
from collections.abc import Iterator
from math import inf, nan

from runtime.commands.arguments import MANUAL, SIMULATED, SIMULATED_CAMERA, given
from runtime.execution import delivery, middle
from runtime.execution.calibration import GripperCalibration
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling
from runtime.execution.reading import CURRENT_MA
from runtime.execution.tips import TipArc, is_arc
from runtime.monitoring.monitor import Views
from runtime.shell.errors import UsageError
from runtime.table import Table, job_of
from runtime.traversal.answer import frames_of
from runtime.traversal.decision import Policy

# factor on the deadlines of a motion that a person makes: about half an hour instead of an arm's seconds
PATIENCE = 200.0


def check_usage(arguments: argparse.Namespace) -> None:
    """Checks that the arguments of `grasp-runtime` fit together, which argparse cannot check.

    Raises:
        UsageError: arguments contradict one another, or one is missing.
    """
    _check_views(arguments)
    if arguments.plc is not None:
        from runtime.commands import plc

        plc.check(arguments)
    elif len(arguments.trees) > 1:
        raise UsageError("--tree is given twice; only a PLC chooses among tables (--plc): name one")
    if arguments.serve is not None:
        from runtime.commands import serve

        serve.check(arguments)
        return
    if (problem := next(_contradictions(arguments), None)) is not None:
        raise UsageError(problem)


def _contradictions(arguments: argparse.Namespace) -> Iterator[str]:
    """Yields a sentence for each contradiction in the arguments of a call without --serve."""
    if arguments.network and arguments.plc is None:
        yield "--network is for --serve and --plc; leave it out, or name an address with one of them"
    if arguments.plc is None and (stated := plc_options(arguments)):
        yield f"{stated[0]} is for --plc opc.tcp; leave it out, or add --plc"
    if arguments.put_down and (arguments.check or arguments.dry_run or arguments.jaws_empty):
        yield "--put-down moves what is held; leave out --check, --dry-run and --jaws-empty"
    if arguments.put_down and arguments.after_crash != "abort":
        yield "--put-down continues no run; leave out --after-crash"
    if arguments.port is None and not arguments.check:
        yield "name the gripper with --port, e.g. --port /dev/ttyUSB0 or --port sim"
    if arguments.put_down and arguments.arm == MANUAL:
        yield "--put-down is for an arm; with --arm manual put it down yourself"
    if arguments.calibration is not None and arguments.port == MANUAL:
        yield "--calibration is of a gripper's readings; with --port manual you tell the width"
    yield from _of_simulation(arguments) if arguments.port == SIMULATED else _of_devices(arguments)


def _of_simulation(arguments: argparse.Namespace) -> Iterator[str]:
    person = arguments.arm == MANUAL
    if not person and arguments.arm not in (None, SIMULATED):
        yield (
            "--port sim brings its own arm; leave out --arm, or write --arm manual, or name the real gripper"
        )
    if arguments.time_scale == inf and arguments.dry_run:
        yield "--dry-run moves nothing, so that time has no scale; leave out --time-scale max"
    if arguments.time_scale == inf and (person or SIMULATED_CAMERA in (arguments.audit or "")):
        yield "--time-scale max allows no camera and no person; name a number, e.g. --time-scale 20"
    if arguments.check:
        yield "--check looks at an attached gripper; name its port, or leave --port out"


def _of_devices(arguments: argparse.Namespace) -> Iterator[str]:
    if arguments.check:
        return
    if SIMULATED_CAMERA in (arguments.audit or ""):
        yield f"{SIMULATED_CAMERA} is the camera of --port sim; name the real one in --audit"
    if arguments.arm in (None, SIMULATED):
        yield (
            "a real gripper needs a real arm; name it with --arm tcp://host:port, or write --arm manual"
        )
    if arguments.arm == arguments.port != MANUAL:
        yield f"--port and --arm both name {arguments.arm}; one of them is another device's"
    if arguments.time_scale != 1.0 or arguments.world is not None:
        yield "--time-scale and --world are for --port sim; a real cell has its own time and world"


def plc_options(arguments: argparse.Namespace) -> list[str]:
    """The given options that are only for `--plc opc.tcp`, such as "--plc-trusted"."""
    return [option for option in given(arguments).values() if option.startswith("--plc-")]


def views(arguments: argparse.Namespace) -> Views:
    """Builds the options of the run's status and live page from --http, --takt, --shifts and --journal."""
    return Views(arguments.http, arguments.takt, arguments.shifts, arguments.journal)


def _check_views(arguments: argparse.Namespace) -> None:
    if arguments.http is None:
        return
    if arguments.check or arguments.dry_run:
        raise UsageError("--http follows a run; leave it out with --check and --dry-run")
    from runtime.monitoring.live import server  # not loaded by a run that nobody watches

    server.parse(arguments.http)


def run_options(
    arguments: argparse.Namespace, table: Table, measured: GripperCalibration | None
) -> RunOptions:
    """Builds the options of a run.

    Args:
        arguments: the parsed command line.
        table: the table that the run executes.
        measured: the gripper's calibration; None: the gripper's nominal widths hold.

    Raises:
        InputError: the file of `--deliver`, or the delivery in the table's job, is refused.
        UsageError: `--on-reject`, `--on-unresolved`, `--tips` or `--deliver` cannot be understood.
    """
    handling = Handling(
        calibration=None if measured is None else measured.of(table.gripper.profile),
        arc=None if arguments.serve is not None else arc_of(arguments, table, measured),
        regulated=arguments.force == "regulated" and arguments.port != MANUAL,
        approaches=arguments.port != MANUAL,
        grip_current_ma=arguments.grip_current,
        current_ma=(measured and measured.current_ma) or CURRENT_MA,
        middle_mm=0.0 if measured is None else middle.off_mm(measured.middle, table),
    )
    policy = Policy.of(arguments.on_reject, arguments.on_unresolved)
    # A robot that uses --serve delivers parts itself.
    place = _delivery(["no"] if arguments.serve is not None else arguments.deliver, table)
    person = _is_manual(arguments)
    return RunOptions(
        policy,
        handling,
        place,
        # A simulated gripper is inactive at first, as a real one is, and can drop no real part.
        activate=arguments.activate or arguments.port == SIMULATED,
        count=arguments.count or (None if arguments.serve or arguments.plc else 1),
        patience=PATIENCE if person else 1.0,
        takt_s=arguments.takt,
        turns=not person,
        timed=arguments.time_scale in (1.0, inf),
    )


def _delivery(words: list[str] | None, table: Table) -> delivery.Places | None:
    """The places that `--deliver` or the table's job states; None: parts are not delivered.

    Raises:
        UsageError: a place is stated, and the table's goal leaves open where a part lies.
    """
    places = _places(words, table)
    goal = table.goal
    if places is not None and (goal.kind == "orientation" or goal.modes > 1):
        kind = f"{goal.kind} ({goal.modes} poses)" if goal.modes > 1 else goal.kind
        raise UsageError(
            f"the table's goal, {kind}, leaves open where a part lies, so it cannot be delivered; "
            "--deliver no runs without"
        )
    return places


def _places(words: list[str] | None, table: Table) -> delivery.Places | None:
    if words is None or words == ["job"]:
        return delivery.from_job(job_of(table))
    if words == ["no"]:
        return None
    if table.hypotheses:
        return delivery.by_name(words, table)
    if len(words) > 1:
        raise UsageError("--deliver is given twice, and the table is of one part; give one place")
    return delivery.from_word(words[0], frames_of(table)[0].picks)


def _is_manual(arguments: argparse.Namespace) -> bool:
    """Whether a person makes the motions of the gripper or of the arm by hand (`manual`)."""
    devices = (arguments.port, arguments.arm)
    return any(device is not None and device.partition("+")[0] == MANUAL for device in devices)


def arc_of(
    arguments: argparse.Namespace, table: Table, measured: GripperCalibration | None
) -> TipArc | None:
    """Determines the arc on which the finger tips move while the jaws close.

    The arc is that in `--tips`, else that in the calibration, else that of the gripper's model. The tips of a
    simulated cell move straight unless `--tips` is given.

    Args:
        arguments: the parsed command line.
        table: the table that the run executes.
        measured: the gripper's calibration; None: no arc was measured.

    Returns:
        The arc; None if the tips move straight, or if a person is the gripper or the arm.

    Raises:
        UsageError: `--tips` cannot be read, or the model's arc has to be measured.
    """
    taught_mm = table.gripper.opening_um / 1000
    if arguments.tips not in (None, "arc", "straight"):
        try:
            link_mm, offset_mm = (float(word) for word in arguments.tips.split(","))
        except ValueError:
            link_mm = offset_mm = nan
        if not is_arc(link_mm, offset_mm):
            raise UsageError(
                f"--tips {arguments.tips}: write straight, arc, or LINK,OFFSET in mm, OFFSET below LINK"
            )
        return None if _is_manual(arguments) else TipArc(link_mm, offset_mm, taught_mm)
    level = arguments.tips is None and arguments.port == SIMULATED
    if arguments.tips == "straight" or level or _is_manual(arguments):
        return None
    if measured is not None and measured.tips_mm is not None:
        return TipArc(*measured.tips_mm, taught_mm)
    model = table.gripper.model
    match table.gripper.profile.arc_mm:
        case link_mm, offset_mm:
            return TipArc(link_mm, offset_mm, taught_mm)
        case (link_mm,):
            raise UsageError(
                f"the tips of a {model} move on an arc whose offset has to be measured: write --tips "
                f"{link_mm:g},OFFSET in mm (tools/docs/grippers.md), or --tips straight for tips that do not"
            )
    return TipArc(taught_mm=taught_mm) if arguments.tips == "arc" else None
