"""The command `grasp-calibrate middle`: measures where the fingers meet, with a block fixed to the table."""

import argparse
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
from math import radians
from pathlib import Path
from typing import Any

from drivers.ports import Drivers
from runtime.commands import options
from runtime.commands.arguments import MANUAL, SIMULATED, address
from runtime.devices.clock import SystemClock
from runtime.devices.lock import PortLock
from runtime.errors import GripperStateError
from runtime.execution import calibration, fixed_block, held, middle, safety, session
from runtime.execution.hand import Hand
from runtime.execution.handling import Handling, check_arc
from runtime.execution.reading import CURRENT_MA
from runtime.execution.safe_state import ending_safely
from runtime.shell import interrupts
from runtime.shell.command import Parser, add_command, number, say, say_result
from runtime.shell.errors import UsageError
from runtime.shell.files import OutputError, usable
from runtime.table import Pose2, Table, load

NAME = "middle"
EXAMPLE = (
    "grasp-calibrate middle --port /dev/ttyUSB0 --arm URL --tree T.msgpack --calibration G.json "
    "--block 30 -o G2.json"
)
DESCRIPTION = """\
Measure where the fingers meet, beside the hand's middle: clamp a block of known width to the table, its sides
square to the jaws. The hand closes on it gently from either side, turns half round, and does so again, 28
times in all. What the table of --tree allows (area, heights, arm speed) holds here, too."""


def add_to(subcommands: Any, codes: str) -> None:
    """Adds the subcommand `middle` with its arguments.

    Args:
        subcommands: the subcommands of `grasp-calibrate`.
        codes: the section of --help with the exit codes.
    """
    purpose = "measure where the fingers meet, with a block fixed to the table"
    parser = add_command(subcommands, purpose, EXAMPLE, codes)
    parser.description = DESCRIPTION
    add = parser.add_argument
    add_shared(parser)
    add("--arm", type=address, required=True, metavar="URL", help="the arm, as for grasp-runtime")
    text = "the table that the cell will run"
    add("--tree", type=Path, required=True, metavar="T.msgpack", help=text)
    text = "the gripper's calibration, as grasp-calibrate width wrote it"
    add("--calibration", type=Path, required=True, metavar="F", help=text)
    text = "the block's width, near that of the part"
    add("--block", type=number, required=True, metavar="MM", help=text)
    text = "the block's centre in mm, to within 4 mm (default: 0,0)"
    add("--at", default="0,0", metavar="X,Y", help=text)
    text = "the hand's angle at which the jaws close square on the block (default: 0)"
    add("--angle", type=number, default=0.0, metavar="DEG", help=text)
    add("-o", "--output", type=Path, required=True, metavar="F2", help="F with the measured middle")
    add("--tips", metavar="straight|arc|LINK,OFFSET", help="as for grasp-runtime")


def add_shared(parser: Parser) -> None:
    """Adds the arguments that `grasp-calibrate width` and `middle` share."""
    add = parser.add_argument
    add("--port", type=address, required=True, help="the gripper, as for grasp-runtime")
    activate = "activate a gripper that is inactive or in fault: its fingers open and close fully"
    add("--activate", action="store_true", help=activate)
    printed = "print one JSON object instead of text; ask on standard error"
    add("--json", action="store_true", help=printed)


def run(arguments: argparse.Namespace, drivers: Drivers, ask: Callable[[str], object]) -> int:
    """Measures where the fingers meet, and writes the calibration with this result to a file; returns 0.

    Args:
        arguments: the parsed command line.
        drivers: opens the devices, moving nothing.
        ask: shows the operator a sentence, and waits for Enter.

    Raises:
        Exception: any error of this package or of a device; each has its `exit_code`.
    """
    at, known = _checked(arguments)
    table = load(arguments.tree).table
    safety.check_table(table)
    measured = known.of(table.gripper.profile)
    arc, current_ma = options.arc_of(arguments, table, known), known.current_ma or CURRENT_MA
    handling = Handling(calibration=measured, arc=arc, current_ma=current_ma)
    check_arc(handling.arc, table.limits, measured)
    node = fixed_block.gripping(table, arguments.block)
    height_mm = table.limits.retreat_height_um / 1000
    for x_mm, y_mm, angle_rad in fixed_block.places(at):
        safety.check_target((x_mm, y_mm, height_mm, angle_rad), table.limits)
    tell = partial(say, file=sys.stderr) if arguments.json else say
    with PortLock(arguments.port), PortLock(arguments.arm):
        gripper = drivers.gripper(arguments.port, table.gripper.profile)
        with closing(gripper), closing(drivers.arm(arguments.arm)) as arm:
            state = gripper.state()
            if holds := held.look(state, measured):
                raise GripperStateError(
                    f"{holds.sentence()}; take it out, open the fingers, start again"
                )
            ask(_warning(arguments, at, table))
            session.prepare_gripper(gripper, tell, activate=arguments.activate)
            hand = Hand(gripper, arm, SystemClock(), table, handling)
            with ending_safely(hand):
                result = fixed_block.measure(hand, node, arguments.block, at, tell)
    completed = replace(known, middle=result)
    interrupts.conclude()  # measured: a stop request has nothing left to stop
    calibration.save(completed, arguments.output)
    _print(arguments, result, table)
    return 0


def _warning(arguments: argparse.Namespace, at: Pose2, table: Table) -> str:
    low_mm, high_mm = table.limits.squeeze_height_um / 1000, table.limits.retreat_height_um / 1000
    return (
        f"The hand will go to ({at[0]:g}, {at[1]:g}) mm at a height of {high_mm:g} mm, come down to "
        f"{low_mm:g} mm 28 times, close on the {arguments.block:g} mm block, and turn half round. See that "
        "the block is clamped there, that the tips meet it at that height, and that nothing else is near. "
        "Keep clear and press Enter."
    )


def _print(arguments: argparse.Namespace, known: middle.Middle, table: Table) -> None:
    width_mm, leaves = middle.narrowest_mm(table), middle.left(known, table)
    beside = middle.off_mm(known, table)
    record = {"output": str(arguments.output), **known._asdict(), "narrowest_mm": width_mm}
    meet = f"{known.across_mm:+.2f} +- {known.across_error_mm:.2f} mm off the hand's middle"
    lines = (
        f"the fingers meet {meet} at {known.block_mm:g} mm, along the hand's y",
        f"the finger at +y makes {100 * known.share:.1f} +- {100 * known.share_error:.1f} % of the closing",
        f"on this table's part, {width_mm:.1f} mm, its places are corrected by {-beside:+.2f} mm",
        "what is left to doubt, for the job:",
        "[doubt]",
        *(f"{key} = [{low:g}, {high:g}]" for key, (low, high) in leaves.items()),
        f"written to {arguments.output}",
    )
    say_result(arguments.json, {**record, "beside_mm": beside, "doubt": leaves}, lines)


def _checked(arguments: argparse.Namespace) -> tuple[Pose2, calibration.GripperCalibration]:
    """Checks the arguments of `middle`, before a device is opened.

    Returns:
        The pose of the block (x mm, y mm, angle rad), and the gripper's calibration.
    """
    if MANUAL in (arguments.port, arguments.arm) or SIMULATED in (arguments.port, arguments.arm):
        raise UsageError(
            "the middle is measured with a gripper on an arm; name both by their addresses "
            "(of a simulated cell: grasp-cell --block)"
        )
    try:
        x_mm, y_mm = (number(word) for word in arguments.at.split(","))
    except (ValueError, argparse.ArgumentTypeError):
        raise UsageError(f"--at {arguments.at!r}: write X,Y in mm, as --at 0,0") from None
    try:
        usable(arguments.output, arguments.calibration, arguments.tree)
    except OutputError as error:
        raise UsageError(f"--output {error}") from error
    measured = calibration.load(arguments.calibration).calibration
    return (x_mm, y_mm, radians(arguments.angle)), measured
