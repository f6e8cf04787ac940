"""`grasp-cell`: a simulated cell with the protocols of the real devices."""

import argparse
import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from drivers.sim.cell import Cell, LoneGripper
from drivers.sim.faults import parse
from drivers.sim.grippers import SIMULATORS
from drivers.sim.physics.scene import REHEARSAL, Block, Setting, load, warm_up
from runtime.shell.command import Parser, number, one_line, positive, run, tell
from runtime.shell.errors import UsageError
from runtime.shell.exit_codes import ExitCode, epilog

EPILOG = """example:
  grasp-cell --tree trees/rectangle/rectangle.msgpack --json
  {"gripper": "/dev/pts/3", "arm": "tcp://127.0.0.1:40001?base=-300,0,0", "scene": ...}

  grasp-cell --gripper dh-ag95 --json
  {"gripper": "/dev/pts/3", "port": "dh:///dev/pts/3"}

The gripper is that of the table or job, on a serial port. A Robotiq gripper (115200 8N1, slave 9) is served
as RTU over TCP, as Modbus TCP (unit 2, registers from 0) and as the text socket of the URCap, too: use one of
the four. The arm is served as an open_abb server and as a UR controller: use one of the two. The scene takes
lines of JSON: {"do": "next_part"}, {"do": "truth"}, {"do": "quit"}. With --camera a webcam looks up through
the table at a tag under the part (needs the audit extra): `grasp-audit judge --camera` takes its address.

""" + epilog(ExitCode.INPUT)


def parser() -> Parser:
    """Creates the parser of the command line."""
    purpose = "Simulate a cell: gripper, arm and part behind the real devices' protocols."
    command = Parser(prog="grasp-cell", description=purpose, epilog=EPILOG)
    source = command.add_mutually_exclusive_group(required=True)
    source.add_argument("--tree", type=Path, metavar="TREE.msgpack", help="part and world")
    source.add_argument("--job", type=Path, metavar="JOB.toml", help="the same from a job file")
    models = f"a gripper alone, with nothing between its fingers: {', '.join(SIMULATORS)}"
    source.add_argument("--gripper", choices=SIMULATORS, metavar="MODEL", help=models)
    add = command.add_argument
    world = f"the physics (default: planner.world:make; without the planner extra {REHEARSAL})"
    add("--world", metavar="MODULE:FACTORY", help=world)
    add("--seed", type=int, default=0, help="of parts, world and noise (default: 0)")
    scale = "simulated seconds per second (default: 1)"
    add("--time-scale", type=positive, default=1.0, metavar="S", help=scale)
    faults = "what goes wrong: seed:N for a random schedule, or a file (drivers/sim/FAULTS.md)"
    add("--faults", metavar="SCHEDULE", help=faults)
    middle = "how far off the hand's middle the fingers meet, along its y (default: 0)"
    add("--middle", type=number, default=0.0, metavar="MM", help=middle)
    block = "instead of parts, a fixed square block (width, x and y of its centre) to measure --middle on"
    add("--block", type=_block, metavar="MM,X,Y", help=block)
    add("--camera", action="store_true", help="serve what a camera under the table sees")
    views = "instead of serving, write the pictures to calibrate that camera from, and the commands for it"
    add("--camera-views", type=Path, metavar="DIR", help=views)
    command.add_common()
    add("--until-stdin-closes", action="store_true", help="end when standard input does")
    return command


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs grasp-cell; returns its exit code."""
    return run(parser(), arguments, serve)


def serve(options: argparse.Namespace) -> int:
    """Starts a cell or a lone gripper, prints its endpoints and serves; returns the exit code.

    With `--camera-views` it writes pictures instead.
    """
    # A background job inherits from its shell that SIGINT is ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if options.gripper is not None:
        _refuse_other_devices(options)
        return _run(LoneGripper(options.gripper, options.seed, options.time_scale), options)
    faults = parse(options.faults)
    setting: Setting = load(options.tree, options.job, options.world)
    setting = setting._replace(middle_mm=options.middle, block=options.block)
    if options.world is None and not setting.truthful:
        tell("grasp-cell", "no planner here; widths are drawn from the table's own statistics")
    if options.camera_views is not None:
        rig = _audit_extra("rig").standard_rig()
        names = [job.part.name for _, job in setting.parts]
        for words in _audit_extra("album").write(rig, options.camera_views, options.seed, names):
            print(f"grasp-calibrate {words}", flush=True)
        return 0
    rig = camera(setting) if options.camera else None
    warm_up(setting, options.seed)
    return _run(Cell(setting, options.seed, options.time_scale, faults, rig), options)


def _refuse_other_devices(options: argparse.Namespace) -> None:
    """Raises a UsageError if a lone gripper is given options that only a whole cell has."""
    for name in ("world", "faults", "middle", "block", "camera", "camera_views"):
        if getattr(options, name):
            word = name.replace("_", "-")
            raise UsageError(
                f"--{word} is of a whole cell, --gripper serves a gripper alone; leave one of the two out"
            )


def _run(serving: Cell | LoneGripper, options: argparse.Namespace) -> int:
    """Serves until asked to end, or until a port fails; returns the exit code.

    A failed port ends the whole cell, since its device would answer no more.
    """
    with serving as running:
        signal.signal(signal.SIGTERM, lambda *_: running.stopped.set())
        if options.until_stdin_closes:
            threading.Thread(target=_watch_stdin, args=(running.stopped,), daemon=True).start()
        if options.json:
            print(json.dumps(running.endpoints), flush=True)
        else:
            lines = (f"{name:16}{value}" for name, value in running.endpoints.items())
            print("\n".join(lines), flush=True)
        running.stopped.wait()
    for failure in running.failures[:1]:
        if options.debug:
            traceback.print_exception(failure)
        tell("grasp-cell", f"stopped: {one_line(failure)}")
    return 1 if running.failures else 0


def _block(text: str) -> Block:
    numbers = [number(word) for word in text.split(",")]
    if len(numbers) not in (1, 3) or numbers[0] <= 0.0:
        raise argparse.ArgumentTypeError(
            f"{text!r}: write its width, or MM,X,Y with the place of its centre"
        )
    return Block(*numbers)


def camera(setting: Setting) -> Any:
    """Creates the camera under the table.

    Raises:
        UsageError: the audit extra is missing, or the world does not know the pose of the part.
    """
    if not setting.truthful:
        raise UsageError(
            f"--camera: a part of {setting.world} lies nowhere; name a world, or install squeezetree[planner]"
        )
    return _audit_extra("rig").standard_rig()


def _audit_extra(name: str) -> Any:
    """Imports a module of the simulated camera; raises a UsageError without the audit extra."""
    try:
        return import_module(f"drivers.sim.camera.{name}")
    except ModuleNotFoundError as error:
        raise UsageError(
            f"the camera needs the audit extra ({error.name} is missing); install squeezetree[audit]"
        ) from error


def _watch_stdin(stopped: threading.Event) -> None:
    # Unbuffered: a buffered reader's lock, held in a blocked read, would abort the interpreter's exit.
    while os.read(0, 4096):
        pass
    stopped.set()


if __name__ == "__main__":
    sys.exit(main())
