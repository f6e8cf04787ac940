"""plan-export: a table as C99, structured text or JSON, for controllers without Python."""

import argparse
from pathlib import Path

from planner.cli import shell
from planner.export.write import FORMS, PREFIX, PREFIXES, write
from runtime.shell.command import Parser
from runtime.shell.errors import UsageError
from runtime.table import load

NAME = "plan-export"


def parser() -> Parser:
    """The parser of the command line."""
    built = shell.parser(
        NAME,
        "Write a decision table for a controller without Python: one C99 header, one function block of IEC "
        "61131-3 structured text, or JSON with its schema; and vectors.csv, what follows every reading.",
        f"{NAME} trees/rectangle/rectangle.msgpack --to c99 -o rectangle-c99",
        f"{NAME} trees/rectangle/rectangle.msgpack --to st -o rectangle-st",
    )
    built.add_argument("tree", type=Path, metavar="TREE.msgpack", help="the table")
    built.add_argument("--to", choices=tuple(FORMS), required=True, help="the form of the table")
    shell.add_output(built, "DIR", "folder for the files, new or empty")
    text = "prefix of the file's name and of all names that the C or structured text defines"
    text = f"{text} (default: {PREFIX}); two tables in one program need two"
    built.add_argument("--prefix", metavar="NAME", help=text)
    return built


def _export(arguments: argparse.Namespace) -> None:
    prefix = arguments.prefix
    if prefix is not None and arguments.to == "json":
        raise UsageError("--prefix is for C and structured text; leave it out with --to json")
    if prefix is not None and PREFIXES.fullmatch(prefix) is None:
        allowed = "1 to 24 of a-z, 0-9 and single underscores, a letter first"
        raise UsageError(f"--prefix {prefix}: write {allowed}")
    result = load(arguments.tree)
    shell.check_one_part(result.table.hypotheses, str(arguments.tree), "an export")
    shell.check_squeezes_alone(result.table, str(arguments.tree), "an export")
    files = write(result, arguments.to, arguments.output, prefix or PREFIX)
    message = ", ".join(f"{name} ({size:,} bytes)" for name, size in files.items())
    figures = {"folder": str(arguments.output), "to": arguments.to, "files": files}
    shell.answer(arguments.json, figures, f"wrote {message} to {arguments.output}")


main = shell.main_of(parser, _export)
