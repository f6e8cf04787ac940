"""The command `squeezetree-completion`: a script by which bash completes what all our commands take."""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from runtime.commands import squeezetree
from runtime.errors import ArgumentsError
from runtime.shell.command import Parser, run

NAME = "squeezetree-completion"
EPILOG = f"""\
example, once and for all shells to come:
  {NAME} > ~/.{NAME} && echo '. ~/.{NAME}' >> ~/.bashrc

Commands whose extra is not installed (planner, audit) are left out; write it again after installing one.

exit codes:
   0  done   2  usage, or the extra completion is not installed
"""


CAMERA = "drivers.camera.calibration.command"
# The module with each command's `parser`.
COMMANDS = {
    squeezetree.NAME: "runtime.commands.squeezetree",
    **{program.name: program.parser for program in squeezetree.PROGRAMS.values()},
}
# Those of subcommands that have a parser of their own.
APART = {
    "grasp-calibrate": {"camera": CAMERA, "tag": CAMERA, "pictures": CAMERA},
    "grasp-audit": {"report": "runtime.spc.command", "study": "runtime.spc.study.command"},
    squeezetree.NAME: {word: program.parser for word, program in squeezetree.PROGRAMS.items()},
}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the script; returns the exit code."""
    return run(parser(), argv, _print_script)


def parser() -> Parser:
    """The command's arguments."""
    return Parser(
        prog=NAME,
        description="Print a script with which bash completes the options of all squeezetree commands.",
        epilog=EPILOG,
    )


def _print_script(_: argparse.Namespace) -> int:
    if find_spec("shtab") is None:
        raise ArgumentsError(
            "needs the completion extra (shtab is missing); install squeezetree[completion]; "
            "in a clone: pip install '.[completion]'"
        )
    print(script(dict(parsers())))
    return 0


def script(found: Mapping[str, argparse.ArgumentParser]) -> str:
    """The script for some commands, whose parsers are given by name."""
    import shtab

    for command in found.values():
        for action in _actions(command):
            if action.type is Path:
                kind = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE
                action.complete = kind  # type: ignore[attr-defined]
    return "\n".join(shtab.complete(command, shell="bash") for command in found.values())


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """The commands whose extras are installed, each with its parser."""
    for name, source in COMMANDS.items():
        command = _parser_in(source)
        if command is None:
            continue
        for subcommand, module in APART.get(name, {}).items():
            if own := _parser_in(module):
                _subcommands(command)[subcommand] = _subcommands(own).get(subcommand, own)
        yield name, command


def _parser_in(module: str) -> argparse.ArgumentParser | None:
    """The parser of a module; None if what it needs is not installed."""
    try:
        command = import_module(module).parser()
    except ModuleNotFoundError as error:
        if (error.name or module).split(".")[0] in ("planner", "runtime", "drivers"):
            raise
        return None
    assert isinstance(command, argparse.ArgumentParser)
    return command


def _subcommands(command: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    for action in command._actions:
        if isinstance(action, argparse._SubParsersAction):
            return action.choices
    return {}


def _actions(command: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    yield from command._actions
    for subcommand in _subcommands(command).values():
        yield from _actions(subcommand)


if __name__ == "__main__":
    sys.exit(main())
