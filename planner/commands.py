"""The entry points of the planner's commands; without the planner extra they say what to install.

A file that is not there is reported before the planner is loaded, which takes seconds of processor time.
"""

import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from runtime.shell.command import entry, tell
from runtime.shell.exit_codes import ExitCode

# Suffixes of the files that some command reads.
INPUTS = {".csv", ".dxf", ".jsonl", ".kicad_mod", ".msgpack", ".stl", ".svg", ".toml", ".txt"}
HELP = {"-h", "--help"}
# Options after which a file that is read may stand.
READ = {"--debug", "--force", "--journal", "--json", "--poses", "--push"}


def missing_input(words: Sequence[str]) -> str | None:
    """The first of a command's arguments that names an input file and is not there.

    Arguments that may belong to an option are passed over: the command itself judges them.
    """
    if not HELP.isdisjoint(words):
        return None
    for before, word in pairwise(("", *words)):
        read = not before.startswith("-") or before in READ
        if read and not word.startswith("-") and Path(word).suffix.lower() in INPUTS:
            try:
                Path(word).stat()
            except FileNotFoundError:
                return word
            except OSError:
                return None
    return None


def _command(name: str, module: str = "") -> Callable[[], int]:
    """The entry point of `plan-<name>`: `main` of `planner.cli.<module>`, by default of its own name."""

    def run() -> int:
        missing = missing_input(sys.argv[1:])
        if missing is not None and find_spec("numpy"):
            tell(
                f"plan-{name}",
                f"{missing}: cannot be read: No such file or directory; check the path",
            )
            return ExitCode.INPUT
        return entry(f"plan-{name}", f"planner.cli.{module or name}", "planner")

    return run


compile_job = _command("compile")
simulate = _command("simulate")
evaluate = _command("evaluate")
expect = _command("expect")
export = _command("export")
identify = _command("identify")
refit = _command("refit")
report = _command("report")
studio = _command("studio")
init = _command("init")
try_part = _command("try", "first_look")
