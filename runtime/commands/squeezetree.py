"""The command `squeezetree`: its subcommands are all programs of this package, in the order of their use.

A subcommand calls the entry point of its program; the other programs are not loaded.
"""

import argparse
import difflib
import sys
from collections.abc import Sequence
from importlib import metadata
from typing import NamedTuple

from runtime.shell.command import Parser, run, say
from runtime.shell.exit_codes import epilog

NAME = "squeezetree"


class Program(NamedTuple):
    """An installed program that a subcommand of `squeezetree` runs."""

    name: str  # name of the program
    purpose: str  # what the subcommand is for
    before: tuple[str, ...] = ()  # arguments that precede the user's arguments


GROUPS: dict[str, dict[str, Program]] = {
    "a part, at the workstation": {
        "try": Program("plan-try", "from a drawing to a first answer, in a minute"),
        "studio": Program("plan-studio", "the same on a page of a browser"),
        "init": Program("plan-init", "begin a job file from a drawing"),
        "plan": Program("plan-compile", "plan a job's squeezes as a table"),
        "evaluate": Program("plan-evaluate", "run a table on simulated parts"),
        "report": Program("plan-report", "a table and its runs, as a page"),
    },
    "a cell": {
        "doctor": Program("grasp-doctor", "check a cell before it runs; moves nothing"),
        "calibrate": Program("grasp-calibrate", "measure widths, or the audit camera"),
        "run": Program("grasp-runtime", "locate parts by a table, in a cell or simulated"),
        "cell": Program("grasp-cell", "a simulated cell that other programs control"),
        "serve": Program("grasp-runtime", "answer a robot: serve ADDRESS ...", ("--serve",)),
    },
    "what happened": {
        "journal": Program("grasp-journal", "show, verify, replay or export it"),
        "audit": Program("grasp-audit", "answers judged by camera; charts, acceptance"),
    },
    "what is installed": {
        "pack": Program("grasp-evidence", "sign a table and its calibration", ("pack",)),
        "verify": Program("grasp-evidence", "check every byte of a pack", ("verify",)),
        "key": Program("grasp-evidence", "make a key to sign with", ("key",)),
    },
    "further": {
        "simulate": Program("plan-simulate", "how single squeezes and pushes end"),
        "expect": Program("plan-expect", "the readings of a healthy cell, for charts"),
        "export": Program("plan-export", "a table in C99, IEC 61131-3 or JSON"),
        "identify": Program("plan-identify", "how a part slides, from pushes"),
        "refit": Program("plan-refit", "what is off in a cell, from its journals"),
    },
}  # the programs by subject and subcommand, in the order of their use
PROGRAMS = {word: program for group in GROUPS.values() for word, program in group.items()}

EPILOG = f"""\
examples:
  {NAME} try part.dxf --units mm
  {NAME} plan part.toml -o part.msgpack
  {NAME} run --tree part.msgpack --port sim --count 20

{epilog()}
A subcommand ends with the exit code of the program that it runs.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a subcommand's program in this process, or prints the overview; returns the exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    if not words or words[0].startswith("-"):
        return run(parser(), words, _overview)
    if words[0] not in PROGRAMS:
        near = difflib.get_close_matches(words[0], PROGRAMS, 1)
        meant = f"; is {near[0]} meant?" if near else ""
        parser().error(f"there is no command {words[0]!r}{meant}")
    return _call(PROGRAMS[words[0]], words[1:])


def parser() -> Parser:
    """Builds the parser of `squeezetree`; each program parses the arguments of its subcommand itself."""
    text = f"{_described()}\n{NAME} COMMAND --help tells more."
    built = Parser(prog=NAME, usage=f"{NAME} COMMAND ...", epilog=EPILOG, description=text)
    built.add_argument("--version", action="version", version=f"{NAME} {metadata.version(NAME)}")
    commands = built.add_subparsers(metavar="COMMAND", help=argparse.SUPPRESS, parser_class=Parser)
    for word in PROGRAMS:
        commands.add_parser(word, add_help=False)
    return built


def _described() -> str:
    """The text of --help that lists all subcommands, each with its purpose and its program."""
    lines = ["Locate planar parts by squeezing them: plan at a workstation, run in a cell."]
    for subject, group in GROUPS.items():
        lines += ["", f"{subject}:"]
        lines += [f"  {word:11s} {each.purpose}  [{each.name}]" for word, each in group.items()]
    return "\n".join([*lines, ""])


def _overview(_: argparse.Namespace) -> int:
    for line in parser().format_help().rstrip().splitlines():
        say(line)
    return 0


def _call(program: Program, rest: list[str]) -> int:
    """Runs a program in this process, as if it were called by its name; returns the exit code.

    Args:
        program: the program.
        rest: the user's arguments after the subcommand.
    """
    # Before --help, an option such as --serve is left out, which would take --help for its value.
    asks = bool({"-h", "--help"} & set(rest))
    before = [word for word in program.before if not (asks and word.startswith("-"))]
    sys.argv = [program.name, *before, *rest]
    scripts = metadata.distribution(NAME).entry_points.select(group="console_scripts")
    return int(scripts[program.name].load()())


if __name__ == "__main__":
    sys.exit(main())
