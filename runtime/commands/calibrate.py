"""The command `grasp-calibrate`: measures a cell's gripper.

Its --help also lists the subcommands for the audit's camera, which another parser handles.
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, TextIO

from drivers.ports import Drivers
from runtime.commands import calibrate_middle
from runtime.devices.clock import SystemClock
from runtime.devices.lock import PortLock
from runtime.execution import calibration, held
from runtime.execution.safe_state import fingers_stop
from runtime.execution.safety import needs_activation, ready_gripper
from runtime.execution.tips import is_arc
from runtime.shell import interrupts
from runtime.shell.command import Parser, add_command, number, say, say_result
from runtime.shell.errors import UsageError
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.shell.files import usable
from runtime.shell.plain_text import is_plain
from runtime.table import DEFAULT_MODEL, PROFILES, Calibration, profile_of

Measured = dict[str, Any]
DEFAULT_BLOCKS = (0, 5, 10, 20, 40, 60, 80, 100, 120)
MOST_NAME = 80  # characters of a gripper's name
OF_THE_AUDIT = {
    "camera": "lens and place of the audit's camera, from pictures of a board",
    "tag": "where a tag is on its part",
    "pictures": "take pictures, one at each Enter",
}
EXAMPLE = "grasp-calibrate width --port /dev/ttyUSB0 --gripper S/N-C-12345 -o gripper.json"
EXIT_CODES = epilog(ExitCode.INPUT, ExitCode.DEVICE, ExitCode.UNREACHABLE, ExitCode.STOPPED)
EPILOG = f"""\
examples:
  {EXAMPLE}
  grasp-runtime --tree T.msgpack --port /dev/ttyUSB0 --calibration gripper.json --check

For each block the fingers open, you hold it between them and press Enter, and they close on it three times,
slowly and with the least force. Keep your own fingers out. Ctrl-C, SIGTERM, SIGHUP, SIGQUIT and the end of
standard input stop the fingers where they are; an activation is reset. To measure the audit's camera, see
grasp-calibrate camera --help, tag --help and pictures --help.

{EXIT_CODES}"""


def parser() -> Parser:
    """Builds the argument parser of `grasp-calibrate`."""
    text = "Measure the parameters of a cell."
    built = Parser(prog="grasp-calibrate", description=text, epilog=EPILOG)
    built.add_debug()
    names = "width | middle | camera | tag | pictures"
    subcommands = built.add_subparsers(required=True, dest="what", metavar=names)
    purpose = "measure the true widths of the gripper's jaws, with gauge blocks"
    width = add_command(subcommands, purpose, EXAMPLE, EXIT_CODES)
    calibrate_middle.add_to(subcommands, EXIT_CODES)
    # Another parser handles the audit's subcommands, before this one; here they are only listed for --help.
    for name, help_text in OF_THE_AUDIT.items():
        subcommands.add_parser(name, help=help_text, add_help=False)
    calibrate_middle.add_shared(width)
    add = width.add_argument
    text = "serial number of the gripper: the file is for this gripper alone"
    add("--gripper", required=True, metavar="NAME", help=text)
    add("-o", "--output", type=Path, required=True, metavar="F", help="the calibration file")
    text = f"the gripper's model: {', '.join(PROFILES)}, or that of another driver (default: {DEFAULT_MODEL})"
    add("--model", metavar="MODEL", default=DEFAULT_MODEL, help=text)
    text = f"widths of the blocks (default: {_blocks(DEFAULT_MODEL)})"
    add("--blocks", metavar="MM,...", help=text)
    text = "times each block is gripped (default: 3)"
    add("--grips", type=int, default=3, metavar="N", help=text)
    text = "the tips' arc in mm, kept in the file for grasp-runtime"
    add("--tips", metavar="LINK,OFFSET", help=text)
    text = "motor current at rest on a part in mA, kept in the file"
    add("--current", metavar="LEAST,MOST", help=text)
    return built


def measured(arguments: argparse.Namespace, drivers: Drivers) -> int:
    """Runs the subcommand `width` or `middle`, which asks the operator at the terminal; returns 0.

    Args:
        arguments: the parsed command line.
        drivers: opens the devices, moving nothing.

    Raises:
        Exception: any error of this package or of a device; each has its `exit_code`.
    """
    ask = partial(_ask_terminal, file=sys.stderr if arguments.json else sys.stdout)
    body = calibrate_middle.run if arguments.what == calibrate_middle.NAME else run
    return body(arguments, drivers, ask)


def run(arguments: argparse.Namespace, drivers: Drivers, ask: Callable[[str], object]) -> int:
    """Measures the widths of the jaws with gauge blocks, and writes the calibration to a file; returns 0.

    Args:
        arguments: the parsed command line.
        drivers: opens the gripper, moving nothing.
        ask: shows the operator a sentence, and waits for Enter.

    Raises:
        Exception: any error of this package or of the gripper; each has its `exit_code`.
    """
    widths_mm, tips, current = _checked(arguments)
    profile = profile_of(arguments.model)
    with PortLock(arguments.port):
        gripper = drivers.gripper(arguments.port, profile)
        with closing(gripper), fingers_stop(gripper):
            state = gripper.state()
            if state.activated and (holds := held.look(state, Calibration(profile))):
                ask(f"Hold on to it, {holds.sentence()}: press Enter, and they open.")
            if arguments.activate and needs_activation(state):
                ask(
                    "The fingers will open and close fully: clear the space between them and press Enter."
                )
                gripper.activate()
            ready_gripper(gripper)
            gauges = list(calibration.measure(gripper, widths_mm, arguments.grips, ask))
    fitted = calibration.fit(gauges, profile, arguments.gripper, SystemClock().stamp())
    fitted = replace(fitted, tips_mm=tips, current_ma=current)
    interrupts.conclude()  # measured: a stop request has nothing left to stop
    calibration.save(fitted, arguments.output)
    seen = figures(fitted)
    lines = (*report(seen), f"written to {arguments.output}")
    say_result(arguments.json, {"output": str(arguments.output), **seen}, lines)
    return 0


def report(measured: Measured) -> Iterator[str]:
    """Yields lines for people: for each gauge block its readings, their spread, and two deviations.

    A deviation is a measured width minus the width of the block. The first is measured by a calibration
    fitted without this block, the second by the gripper's nominal widths. The narrowest and the widest block
    have only the second.

    Args:
        measured: the measurement, as `figures` returns it.
    """
    yield f"gripper {measured['gripper']}"
    yield "block mm  read mm               spread  without this block  nominal"
    for block in measured["blocks"]:
        off = block["off_without_it_mm"]
        alone = "-" if off is None else f"{off:+.3f} mm"
        read = " ".join(f"{reading:.2f}" for reading in block["read_mm"])
        line = f"{block['width_mm']:8.2f}  {read:<20}  {block['spread_mm']:6.2f}  {alone:>18}"
        yield f"{line}  {block['off_nominal_mm']:+.3f} mm"


def figures(measured: calibration.GripperCalibration) -> Measured:
    """Converts a calibration to the form of JSON, and adds the two deviations of each block for `report`."""
    left_out = [None, *calibration.residuals_mm(measured)]
    blocks = [
        {
            "width_mm": gauge.width_mm,
            "read_mm": [reading / 1000 for reading in gauge.readings_um],
            "spread_mm": gauge.spread_um / 1000,
            "off_without_it_mm": off,
            "off_nominal_mm": gauge.mean / 1000 - gauge.width_mm,
        }
        for gauge, off in zip_longest(measured.gauges, left_out)
    ]
    return {"gripper": measured.gripper, "blocks": blocks}


def _ask_terminal(sentence: str, file: TextIO) -> None:
    say(sentence, file)
    with suppress(OSError):  # the terminal is gone
        if sys.stdin.readline():
            return
    raise UsageError("standard input ended before Enter was pressed; run it in a terminal")


def _checked(
    arguments: argparse.Namespace,
) -> tuple[list[float], tuple[float, float] | None, tuple[int, int] | None]:
    """Checks the arguments of `width`, before the operator is asked for a block.

    Returns:
        Widths of the gauge blocks (ascending, mm); length of the finger links and offset of the tips (mm),
        None if not given; least and most motor current (mA), None if not given.
    """
    named = _blocks(arguments.model) if arguments.blocks is None else arguments.blocks
    widths_mm = sorted(_numbers("--blocks", named))
    if arguments.grips < 1 or widths_mm[0] < 0.0:
        raise UsageError("--grips takes at least 1, --blocks widths of at least 0 mm")
    if len(widths_mm) < calibration.LEAST_BLOCKS or len(set(widths_mm)) < len(widths_mm):
        raise UsageError(f"--blocks {named!r}: name at least {calibration.LEAST_BLOCKS}, each once")
    stroke_mm = profile_of(arguments.model).stroke_um / 1000
    if widths_mm[-1] > stroke_mm:
        raise UsageError(f"--blocks {named!r}: a {arguments.model} opens {stroke_mm:g} mm")
    if not is_plain(arguments.gripper, MOST_NAME):
        raise UsageError(
            f"--gripper {arguments.gripper!r}: name it in one line of printable characters"
        )
    usable(arguments.output)
    tips = _pair("--tips", arguments.tips)
    current = _pair("--current", arguments.current)
    if tips is not None and not is_arc(*tips):
        raise UsageError(
            f"--tips {arguments.tips!r}: name LINK,OFFSET in mm, the offset below the link"
        )
    if current is not None and not 0.0 <= current[0] < current[1]:
        raise UsageError(f"--current {arguments.current!r}: name LEAST,MOST in mA, the least first")
    return widths_mm, tips, None if current is None else (round(current[0]), round(current[1]))


def _blocks(model: str) -> str:
    """Widths of the usual gauge blocks that fit between a model's fingers, in the form of `--blocks`, mm."""
    stroke_um = profile_of(model).stroke_um
    return ",".join(str(width) for width in DEFAULT_BLOCKS if 1000 * width < stroke_um)


def _pair(option: str, text: str | None) -> tuple[float, float] | None:
    """Parses the value of an option that takes two numbers; returns None if the option was not given."""
    if text is None:
        return None
    first, *others = _numbers(option, text)
    if len(others) != 1:
        raise UsageError(f"{option} {text!r}: takes 2 numbers")
    return first, others[0]


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [number(word) for word in text.split(",")]
    except argparse.ArgumentTypeError:
        raise UsageError(f"{option} {text!r}: write numbers separated by commas") from None
