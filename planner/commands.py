"""Entry points of the planner's commands; without the planner extra they state what to install.

An entry point reports a missing input file before it loads the planner, since loading takes seconds.
"""

import sys
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

from runtime.shell.command import entry, tell
from runtime.shell.exit_codes import ExitCode

# Suffixes of input files.
INPUTS = {".csv", ".dxf", ".jsonl", ".kicad_mod", ".msgpack", ".stl", ".svg", ".toml", ".txt"}
HELP = {"-h", "--help"}
# Options after which an input file may stand.
READ = {"--debug", "--force", "--journal", "--json", "--poses", "--push"}


def missing_input(words: Sequence[str]) -> str | None:
    """Returns the first argument of a command that names an input file which does not exist, or None.

    An argument after an option that is not in `READ` is skipped, since it may be the option's value; the
    command itself checks it.
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
    """Returns the entry point of `plan-<name>`, which calls `main` of `planner.cli.<module or name>`."""

    def run() -> int:
        missing = missing_input(sys.argv[1:])
        if missing is not None and find_spec("numpy"):
            problem = "cannot be read: No such file or directory; check the path"
            tell(f"plan-{name}", f"{missing}: {problem}")
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
