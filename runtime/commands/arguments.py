"""Defines the command-line arguments of `grasp-runtime`."""

import argparse
import json
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

from runtime.execution import safe_state
from runtime.monitoring.shift import CHANGES
from runtime.shell.command import Parser, named_path, positive, positive_int, say, seconds
from runtime.shell.exit_codes import ExitCode, epilog

Add = Callable[..., object]  # `add_argument` of a group
DEFAULT_JOURNAL = Path("squeezetree-journal.jsonl")
SIMULATED = "sim"
MANUAL = "manual"  # address of a device whose motions a person makes by hand
SIMULATED_CAMERA = "{camera}"  # in --audit: the address of the simulated cell's camera
# Options that --serve allows. The other options are about devices, which the robot moves itself.
SERVED = {
    *("serve", "network", "trees", "count", "journal", "json", "debug", "calibration"),
    *("on_reject", "on_unresolved", "http", "shifts", "require_signed"),
}

ENDS = (ExitCode.INPUT, ExitCode.NOT_LOCATED, ExitCode.DEVICE, ExitCode.UNREACHABLE)
RUN_CODES = epilog(*ENDS, ExitCode.JOURNAL, ExitCode.SIGNATURE, ExitCode.STOPPED)
EPILOG = f"""\
examples:
  grasp-runtime --tree trees/rectangle/rectangle.msgpack --port sim --count 5 --time-scale 20
  grasp-runtime --tree trees/rectangle/rectangle.msgpack --port sim --count 100 --http 8080
  grasp-runtime --tree T.msgpack --port /dev/ttyUSB0 --calibration gripper.json --check
  grasp-runtime --tree T.msgpack --port /dev/ttyUSB0 --arm tcp://192.168.125.1:5000 --dry-run
  grasp-runtime --tree T.msgpack --port manual --arm manual
  grasp-runtime --tree T.msgpack --port sim --plc modbus-tcp://127.0.0.1:5020 --json
  grasp-runtime --tree T.msgpack --serve tcp://127.0.0.1:5020

{RUN_CODES}
With --count above 1, rejected, unresolved and undelivered parts do not end the run unless the policy says
stop; a fault or a stop does. The exit code is that of the worst part. A real cell feeds its parts
by itself, a simulated one brings the next.

Connecting moves nothing. Every fault, and every stop request (Ctrl-C, SIGTERM, SIGHUP, SIGQUIT), ends in the
declared safe state; what came first gives the exit code:
{safe_state.DECLARED}.
"""


def address(text: str) -> str:
    """Returns a device's address unchanged, for argparse; refuses only a misspelt `sim` or `manual`."""
    words = (SIMULATED, MANUAL)
    if text in words or ":" in text or Path(text).exists():
        return text
    import difflib  # not loaded unless there may be a mistake

    near = difflib.get_close_matches(text.lower(), words, 1)
    if near:
        raise argparse.ArgumentTypeError(f"{text!r} is no port; is {near[0]} meant?")
    return text


def given(arguments: argparse.Namespace) -> dict[str, str]:
    """The options of `grasp-runtime` whose values differ from the defaults.

    Returns:
        A mapping from the names in the parsed arguments, such as "time_scale", to options, "--time-scale".
    """
    defaults, values = parser(), vars(arguments).items()
    names = (name for name, value in values if value != defaults.get_default(name))
    return {name: f"--{name.replace('_', '-')}" for name in names}


class PrintedMap(argparse.Action):
    """The action of the option `--plc-map`: prints the register map for a PLC, and exits as --help does."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Prints the register map as JSON, and exits."""
        from runtime.plc import registers  # not loaded by a run without a PLC

        say(json.dumps(registers.as_json()))
        parser.exit()


def parser() -> Parser:
    """Builds the argument parser of `grasp-runtime`."""
    text = "Localise parts by executing a decision table on a cell."
    built = Parser(prog="grasp-runtime", description=text, epilog=EPILOG)
    add = built.add_argument
    text = "the table, as plan-compile wrote it; with --plc repeat the option for several tables"
    add("--tree", type=Path, required=True, action="append", dest="trees", metavar="T", help=text)
    text = (
        "the gripper: sim (starts grasp-cell), /dev/..., tcp://host:port, rtu+tcp://host:port, urcap://host, "
        "can:..., dh:///dev/..., manual (you type the width that calipers show), or a driver's own scheme"
    )
    add("--port", type=address, help=text)
    text = (
        "the arm: tcp://host:port, ur://host, omnicore://host, manual (you move the hand as you are asked "
        "to), or a driver's own scheme; not with --port sim, which has one"
    )
    add("--arm", type=address, help=text)
    text = (
        "number of parts, including those before a crash (default: 1; no end with --serve, --plc)"
    )
    add("--count", type=positive_int, metavar="N", help=text)
    text = "activate a gripper that is inactive or in fault: its fingers open and close fully"
    add("--activate", action="store_true", help=text)
    text = f"append the run to this journal, after verifying its latest file (default: ./{DEFAULT_JOURNAL})"
    add("--journal", type=named_path, default=DEFAULT_JOURNAL, metavar="P", help=text)
    text = (
        "public key: refuse the run unless a pack beside the table, signed with this key, holds the run's "
        "table and calibration (squeezetree pack)"
    )
    add("--require-signed", type=Path, metavar="KEY", help=text)
    built.add_common(
        "print one JSON object a part, or one for --check or --dry-run; messages go to standard error"
    )
    _add_instead(built.add_argument_group("instead of a run").add_argument)
    _add_handling(built.add_argument_group("how parts are handled").add_argument)
    _add_policy(built.add_argument_group("what follows").add_argument)
    _add_views(built.add_argument_group("who watches").add_argument)
    _add_simulated(built.add_argument_group("with --port sim").add_argument)
    return built


def _add_instead(add: Add) -> None:
    text = "validate the table against the gripper's calibration, read the gripper at --port, move nothing"
    add("--check", action="store_true", help=text)
    text = "connect over links that cannot write, and print what would be sent"
    add("--dry-run", action="store_true", help=text)
    text = "put down what the fingers still hold: straight down where the arm stands, open, retreat, end"
    add("--put-down", action="store_true", help=text)
    text = (
        "answer the lines of a robot that connects there, one robot at a time (tools/docs/serve.md); port 0 "
        "takes a free port and prints it"
    )
    add("--serve", metavar="tcp://HOST:PORT", help=text)
    text = (
        "a PLC is the master: serve modbus-tcp://HOST:PORT, or opc.tcp://HOST:PORT (extra opcua), and run a "
        "part at each of its triggers (tools/docs/plc.md); port 0 takes a free port and prints it"
    )
    add("--plc", metavar="URL", help=text)
    text = "print the registers of --plc, and start nothing"
    add("--plc-map", action=PrintedMap, choices=("json",), help=text)
    text = (
        "with opc.tcp: folder of the server's key and certificate, created if missing, and of the first "
        "client's certificate, the only one admitted (default: JOURNAL.opcua, beside the journal)"
    )
    add("--plc-certificates", type=Path, metavar="FOLDER", help=text)
    text = "with opc.tcp: admit the clients whose certificates are in this folder, not the first client"
    add("--plc-trusted", type=Path, metavar="FOLDER", help=text)
    text = "with opc.tcp: neither sign nor encrypt, and admit every client"
    add("--plc-insecure", action="store_true", help=text)
    text = (
        "with --serve, --plc: HOST may be an address that other machines reach; there is no password, and "
        "without opc.tcp no certificate either"
    )
    add("--network", action="store_true", help=text)


def _add_handling(add: Add) -> None:
    text = "calibration of this gripper, as grasp-calibrate wrote it"
    add("--calibration", type=Path, metavar="F", help=text)
    text = (
        "how the tips move while the jaws do: arc, straight, or LINK,OFFSET in mm (default: arc on a 2F-85, "
        "whose arm then moves with the jaws, and on a 2F-140, with a measured OFFSET; straight in a "
        "simulated cell, whose tips do); a person who is arm or gripper keeps the tips level without it"
    )
    add("--tips", metavar="ARC", help=text)
    text = (
        "close gently, then raise the force; or close with the table's force (default: regulated)"
    )
    add("--force", choices=("regulated", "direct"), default="regulated", help=text)
    text = "raise the force no further once the motor draws this much (default: up to the table's force)"
    add("--grip-current", type=positive_int, metavar="MA", help=text)
    text = (
        "take a localised part and put it down there (default: as the job's section delivery says); for a "
        "table of several parts once for each NAME: a part that is not named stays where it lies"
    )
    add("--deliver", action="append", metavar="[NAME=]X,Y,ANGLE|FILE|no", help=text)
    text = (
        "ask this program, by lines of JSON, for a verdict on each located part, and once before the run; "
        "{camera} stands for the address of the camera of --port sim"
    )
    add("--audit", metavar="COMMAND", help=text)


def _add_policy(add: Add) -> None:
    text = "start although the fingers may hold something: you see that they do not (a held part falls)"
    add("--jaws-empty", action="store_true", help=text)
    text = (
        "what follows a reject, each once a part, in this order: resqueeze, restart; and last next or stop "
        "(default: next)"
    )
    add("--on-reject", default="next", metavar="LIST", help=text)
    text = "what follows an unresolved leaf: restart; and last next or stop (default: next)"
    add("--on-unresolved", default="next", metavar="LIST", help=text)
    text = (
        "if the journal's last run broke off: give it up and exit 24, continue its part, or restart that "
        "part (default: abort)"
    )
    add("--after-crash", choices=("abort", "resume", "restart"), default="abort", help=text)
    text = (
        "continue with a part only if its last record is at most so many seconds old (default: 300)"
    )
    add("--resume-within", type=positive, default=300.0, metavar="S", help=text)


def _add_views(add: Add) -> None:
    text = (
        "serve a page that follows the run, with /status.json and /metrics; read-only, and for this machine "
        "alone unless HOST is an address that other machines reach"
    )
    add("--http", metavar="[HOST:]PORT", help=text)
    text = "hours at which shifts change, for the page's figures (default: 6,14,22)"
    add("--shifts", type=hours, default=CHANGES, metavar="H,H,...", help=text)
    text = "also print at the end the share of parts that were done within this time"
    add("--takt", type=seconds, metavar="6s", help=text)


def hours(text: str) -> tuple[int, ...]:
    """Parses hours of the day separated by commas, such as "6,14,22", for argparse."""
    words = text.split(",")
    if not all(word.isascii() and word.isdecimal() and int(word) < 24 for word in words):
        raise argparse.ArgumentTypeError(f"{text!r}: write hours from 0 to 23, such as 6,14,22")
    return tuple(map(int, words))


def _add_simulated(add: Add) -> None:
    text = "speed as a multiple of real time; max: virtual time, in this process"
    add("--time-scale", type=time_scale, default=1.0, metavar="S", help=text)
    add("--seed", type=int, default=0, metavar="N", help="of the simulated cell (default: 0)")
    text = "physics of the cell, as module:factory (default: the planner's, or a rehearsal without planner)"
    add("--world", metavar="M:F", help=text)


def time_scale(text: str) -> float:
    """Parses the speed of a simulated cell, for argparse: a multiple of real time; "max" becomes infinity."""
    return inf if text == "max" else positive(text)
