"""The command `grasp-runtime`: executes a decision table on a cell, real or simulated."""

import argparse
import sys
import traceback
from collections.abc import Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from drivers import connect
from runtime import safe_state, session
from runtime.cell_process import CellProcess
from runtime.clock import SystemClock
from runtime.console import Console, Lines, Objects
from runtime.errors import CellError, StoppedError, UsageError
from runtime.executor import Cell
from runtime.interrupts import StopRequests
from runtime.journal import Journal
from runtime.ports import Arm, Gripper, Scene
from runtime.safety import check_table
from runtime.table import PPM, Table, dumps, load

REHEARSAL = "runtime.rehearsal:make"
CONTACT_WORLD = "planner.world:make"
PLANNER_NEEDS = ("numpy", "scipy", "numba", "planner.world")
DEFAULT_JOURNAL = Path("squeezetree-journal.jsonl")

EPILOG = f"""\
example:
  grasp-runtime --tree trees/rectangle/rectangle.msgpack --port sim --count 5 --time-scale 20

exit codes:
   0  every part reached a leaf        21  gripper fault, or not activated
   1  internal error: a bug            22  arm fault, or a motion refused
   2  usage                            23  a port cannot be opened
   3  table file missing or unreadable 24  journal cannot be written
  10  a part was rejected              30  table invalid
  11  a part stayed unresolved         31  simulated cell failed to start
  20  gripper link fault               40  stopped by the operator

With --count above 1, rejected and unresolved parts do not end the run, a fault or a stop does; the exit code
is the highest that any part earned. A real cell feeds its parts by itself, a simulated one brings the next.

Connecting moves nothing. Every fault, and Ctrl-C, ends in the declared safe state:
{safe_state.DECLARED}.
"""


class Devices(NamedTuple):
    """What a run talks to; a scene only where the cell is simulated."""

    gripper: Gripper
    arm: Arm
    scene: Scene | None


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command.

    Args:
        argv: its arguments, without the program's name; None for the process's own.

    Returns:
        The exit code.
    """
    arguments = parser().parse_args(argv)
    with StopRequests():
        try:
            return run(arguments)
        except KeyboardInterrupt:
            print("grasp-runtime: stopped by the operator while no part was being squeezed", file=sys.stderr)
            return StoppedError.exit_code
        except Exception as error:
            return _told(error, debug=arguments.debug)


def run(arguments: argparse.Namespace) -> int:
    """Execute a table as the parsed arguments say.

    Returns:
        The exit code of the parts.

    Raises:
        Exception: any error of ours or of a device; each carries its `exit_code`.
    """
    _check_usage(arguments)
    table = load(arguments.tree)
    check_table(table)
    console: Console = Objects(table, arguments.journal) if arguments.json else Lines(table)
    console.note(_headline(arguments.tree, table))
    with ExitStack() as stack:
        devices = _connect(arguments, table, console, stack)
        clock = SystemClock(arguments.time_scale)
        journal = stack.enter_context(Journal(arguments.journal, clock.stamp))
        journal.header(dumps(table), _header(arguments))
        cell = Cell(devices.gripper, devices.arm, clock, journal)
        # A simulated gripper powers up in reset like a real one, and nothing real is between its fingers.
        activate = arguments.activate or arguments.port == "sim"
        results = session.run_journalled(
            table, cell, devices.scene, console, count=arguments.count, activate=activate
        )
        console.summary(results, arguments.journal)
        return session.exit_code(results)


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    built = argparse.ArgumentParser(
        prog="grasp-runtime",
        description="Localise parts by executing a decision table on a cell.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = built.add_argument
    add("--tree", type=Path, required=True, metavar="T", help="the table, as plan-compile wrote it")
    add(
        "--port",
        required=True,
        help="the gripper: sim (starts grasp-cell), /dev/..., tcp://host:port, rtu+tcp://host:port",
    )
    add("--arm", help="the arm: tcp://host:port; with --port sim its own")
    add("--count", type=_positive_int, default=1, metavar="N", help="number of parts (default 1)")
    add("--activate", action="store_true", help="activate the gripper if need be: the fingers sweep fully")
    add(
        "--journal",
        type=Path,
        default=DEFAULT_JOURNAL,
        metavar="P",
        help=f"append the run to this file, after verifying it (default ./{DEFAULT_JOURNAL})",
    )
    add("--json", action="store_true", help="one JSON object a part, sentences on standard error")
    add("--debug", action="store_true", help="print the traceback of an error")
    simulated = built.add_argument_group("with --port sim")
    simulated.add_argument(
        "--time-scale", type=_positive, default=1.0, metavar="S", help="times as fast as life"
    )
    simulated.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the simulated cell (default 0)"
    )
    simulated.add_argument(
        "--world",
        metavar="M:F",
        help=f"physics of the cell (default {CONTACT_WORLD}; without the planner extra {REHEARSAL})",
    )
    return built


def _check_usage(arguments: argparse.Namespace) -> None:
    if arguments.port == "sim":
        if arguments.arm not in (None, "sim"):
            raise UsageError(
                "--port sim brings its own arm; leave out --arm, or name the real gripper's port"
            )
        return
    if arguments.arm in (None, "sim"):
        raise UsageError("a real gripper needs a real arm; name it with --arm tcp://host:port")
    if arguments.time_scale != 1.0 or arguments.world is not None:
        raise UsageError(
            "--time-scale and --world are for --port sim; a real cell has its own time and world"
        )


def _connect(arguments: argparse.Namespace, table: Table, console: Console, stack: ExitStack) -> Devices:
    """Connect to the devices; for a simulated cell start it first and then talk to it as to hardware."""
    gripper_port, arm_url, scene_url = arguments.port, arguments.arm, None
    if arguments.port == "sim":
        world = arguments.world or _default_world(table, console)
        process = CellProcess(
            arguments.tree, world=world, seed=arguments.seed, time_scale=arguments.time_scale
        )
        cell = stack.enter_context(process).endpoints
        gripper_port, arm_url, scene_url = cell.gripper, cell.arm, cell.scene
        console.note(f"simulated cell ({cell.world}), {arguments.time_scale:g} times as fast as life")
    gripper = connect.gripper(gripper_port, time_scale=arguments.time_scale)
    stack.callback(gripper.close)
    arm = connect.arm(arm_url, time_scale=arguments.time_scale)
    stack.callback(arm.close)
    if scene_url is None:
        return Devices(gripper, arm, None)
    scene = connect.scene(scene_url)
    stack.callback(scene.close)
    return Devices(gripper, arm, scene)


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


def _header(arguments: argparse.Namespace) -> dict[str, object]:
    return {
        "table": str(arguments.tree),
        "port": arguments.port,
        "arm": arguments.arm,
        "count": arguments.count,
        "time_scale": arguments.time_scale,
        "seed": arguments.seed if arguments.port == "sim" else None,
        "declared_safe_state": safe_state.DECLARED,
    }


def _told(error: Exception, *, debug: bool) -> int:
    code = getattr(error, "exit_code", None)
    if debug:
        traceback.print_exc()
    if isinstance(code, int) and (code != 1 or isinstance(error, CellError)):
        print(f"grasp-runtime: {error}", file=sys.stderr)
        return code
    name = type(error).__name__
    print(
        f"grasp-runtime: internal error, please report it: {name}: {error} (--debug shows more)",
        file=sys.stderr,
    )
    return 1


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def _positive_int(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not at least 1")
    return value


if __name__ == "__main__":
    sys.exit(main())
