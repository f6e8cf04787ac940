"""The argument parsers of all commands and of their subcommands."""

import argparse
from importlib import import_module

from runtime.commands import squeezetree

PLANNER = "first_look studio init compile evaluate report simulate expect export identify refit"
CELL = "doctor calibrate arguments journal evidence"
MODULES = (
    *(f"planner.cli.{name}" for name in PLANNER.split()),
    *(f"runtime.commands.{name}" for name in CELL.split()),
    *("drivers.sim.cli", "drivers.camera.audit.command"),
)
CAMERA = "drivers.camera.calibration.command"
APART = {
    "grasp-calibrate": {"camera": CAMERA, "tag": CAMERA, "pictures": CAMERA},
    "grasp-audit": {"report": "runtime.spc.command", "study": "runtime.spc.study.command"},
}
"""Subcommands whose parser is in a module of its own."""


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each installed program, by the name of the program."""
    result = {squeezetree.NAME: squeezetree.parser()}
    for name in MODULES:
        parser = import_module(name).parser()
        for word, module in APART.get(parser.prog, {}).items():
            other = import_module(module).parser()
            subcommands(parser)[word] = subcommands(other).get(word, other)
        result[parser.prog] = parser
    return result


def subcommands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of a command's subcommands, by the name of the subcommand."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return action.choices
    return {}
