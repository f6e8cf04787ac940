"""What the arguments of `grasp-runtime` mean for a run, and which of them contradict one another."""

import argparse
import os
import sys
from importlib.util import find_spec
from pathlib import Path

from runtime.commands.arguments import SIMULATED, SIMULATED_CAMERA
from runtime.errors import ArgumentsError
from runtime.execution import calibration, delivery
from runtime.execution.calibration import GripperCalibration
from runtime.execution.executor import RunOptions
from runtime.execution.hand import Handling
from runtime.execution.reading import CURRENT_MA
from runtime.execution.tips import TipArc
from runtime.monitoring.monitor import Views
from runtime.table import Table, job_of
from runtime.traversal.decision import Policy

ARC_MODELS = ("2f-85", "c-85")


def check_usage(arguments: argparse.Namespace) -> None:
    """Check what argparse alone cannot judge.

    Raises:
        ArgumentsError: arguments contradict one another, or one is missing.
    """
    simulated = arguments.port == SIMULATED
    _check_views(arguments)
    if arguments.put_down and (arguments.check or arguments.dry_run or arguments.jaws_empty):
        raise ArgumentsError("--put-down moves what is held; leave out --check, --dry-run and --jaws-empty")
    if arguments.put_down and arguments.after_crash != "abort":
        raise ArgumentsError("--put-down goes on with no run; leave out --after-crash")
    if arguments.port is None and not arguments.check:
        raise ArgumentsError("name the gripper with --port, e.g. --port /dev/ttyUSB0 or --port sim")
    if simulated and arguments.arm not in (None, SIMULATED):
        raise ArgumentsError(
            "--port sim brings its own arm; leave out --arm, or name the real gripper's port"
        )
    if simulated and arguments.check:
        raise ArgumentsError("--check looks at an attached gripper; name its port, or leave --port out")
    if simulated or arguments.check:
        return
    if SIMULATED_CAMERA in (arguments.audit or ""):
        raise ArgumentsError(f"{SIMULATED_CAMERA} is the camera of --port sim; name the real one in --audit")
    if arguments.arm in (None, SIMULATED):
        raise ArgumentsError("a real gripper needs a real arm; name it with --arm tcp://host:port")
    if arguments.arm == arguments.port:
        raise ArgumentsError(f"--port and --arm both name {arguments.arm}; one of them is another device's")
    if arguments.time_scale != 1.0 or arguments.world is not None:
        raise ArgumentsError(
            "--time-scale and --world are for --port sim; a real cell has its own time and world"
        )


def views(arguments: argparse.Namespace) -> Views:
    """Where the run is shown besides the console; a pipe and a dumb terminal get its plain lines."""
    # With --json standard output is for machines; the picture then needs a terminal of its own.
    stream = sys.stderr if arguments.json else sys.stdout
    drawn = arguments.watch and stream.isatty() and os.environ.get("TERM", "dumb") not in ("dumb", "unknown")
    if arguments.json and sys.stdout.isatty():
        drawn = False
    return Views(arguments.status, arguments.http, stream if drawn else None)


def _check_views(arguments: argparse.Namespace) -> None:
    if not arguments.watch and arguments.http is None:
        return
    if arguments.check or arguments.dry_run:
        raise ArgumentsError("--watch and --http follow a run; leave them out with --check and --dry-run")
    if arguments.http is not None:
        from runtime.monitoring.live import server  # not loaded into a run that nobody watches

        server.parse(arguments.http)
    if views(arguments).terminal is not None and find_spec("rich") is None:
        raise ArgumentsError("--watch needs rich; install it with: pip install 'squeezetree[watch]'")


def run_options(arguments: argparse.Namespace, table: Table) -> RunOptions:
    """What the run does besides what its table says.

    Raises:
        CalibrationError: the calibration file is refused.
        ArgumentsError: a policy, an arc or a delivery is not understood.
    """
    measured = None if arguments.calibration is None else calibration.load(arguments.calibration)
    handling = Handling(
        calibration=None if measured is None else measured.table,
        arc=_arc(arguments, table, measured),
        regulated=arguments.force == "regulated",
        grip_current_ma=arguments.grip_current,
        current_ma=(measured and measured.current_ma) or CURRENT_MA,
    )
    policy = Policy.of(arguments.on_reject, arguments.on_unresolved)
    return RunOptions(policy, handling, _delivery(arguments.deliver, table))


def _delivery(named: str, table: Table) -> delivery.Delivery | None:
    if named == "no":
        return None
    if named == "job":
        return delivery.from_job(job_of(table))
    return delivery.from_text(named) if "," in named else delivery.from_file(Path(named))


def _arc(arguments: argparse.Namespace, table: Table, measured: GripperCalibration | None) -> TipArc | None:
    """The tips' arc: as named, else as measured, else that of the model; none in a simulated cell."""
    taught_mm = table.gripper.opening_um / 1000
    if arguments.tips not in (None, "arc", "straight"):
        try:
            link_mm, offset_mm = (float(word) for word in arguments.tips.split(","))
        except ValueError:
            raise ArgumentsError(
                f"--tips {arguments.tips}: write straight, arc, or LINK,OFFSET in mm"
            ) from None
        return TipArc(link_mm, offset_mm, taught_mm)
    if arguments.tips == "straight" or (arguments.tips is None and arguments.port == SIMULATED):
        return None
    if measured is not None and measured.tips_mm is not None:
        return TipArc(*measured.tips_mm, taught_mm)
    known = any(model in table.gripper.model.lower() for model in ARC_MODELS)
    return TipArc(taught_mm=taught_mm) if known or arguments.tips == "arc" else None
