"""What all planner commands share beside `runtime.shell`: exit codes, options, output files, progress."""

import argparse
import json
import logging
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich import progress as bars
from rich.console import Console

from planner.errors import InputFileError, UsageError
from planner.job import model as job_file
from planner.job.model import Job
from planner.kernel import CACHE_VARIABLE, cache_folder
from planner.learned.store import Store, StoreWarning
from planner.work.progress import Report, silent
from runtime.shell import command
from runtime.shell.command import INTERRUPTED, Parser
from runtime.shell.files import folder
from runtime.table import TableFile, load

WIDTH = 98  # columns of what --help says
PICTURES = (".png", ".svg", ".pdf")  # what matplotlib's pictures may end in
ROLL_OUTS = "rollouts"  # folder of the roll-outs in the cache folder
EXIT_CODES = """\
exit codes:
  0 done; 1 internal error; 2 usage; 3 a file is missing or cannot be used; 4 not valid TOML; 5 unknown or
  missing key; 6 value out of range; 7 outline invalid; 8 part does not fit the gripper; 9 no plan reaches
  the goal; 30 table invalid; 32 cluster not reached or lost; 130 interrupted (nothing is left half written)
"""


def parser(name: str, description: str, *examples: str) -> Parser:
    """An argument parser with the options and the epilogue that all commands have."""
    shown = "\n  ".join(examples)
    result = Parser(
        prog=name,
        description=textwrap.fill(description, WIDTH),
        epilog=f"example{'s' * (len(examples) > 1)}:\n  {shown}\n\n{EXIT_CODES}",
    )
    result.add_common()
    return result


def checked_suffix(option: str, path: Path, suffixes: Sequence[str]) -> Path:
    """The path that an option names.

    Raises:
        UsageError: it ends in none of the suffixes.
    """
    if path.suffix.lower() not in suffixes:
        raise UsageError(f"{option} {path} must end in {', '.join(suffixes)}")
    return path


def seconds(text: str) -> float:
    """A positive time such as 90, 90s or 1.5min, for argparse [s]."""
    if text.endswith("min"):
        return 60.0 * command.positive(text.removesuffix("min"))
    return command.positive(text.removesuffix("s"))


def add_cache(parser: argparse.ArgumentParser) -> None:
    """The options that say where roll-outs are kept; `store_of` reads them."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--no-cache", action="store_true", help="roll everything out again, and keep nothing")
    group.add_argument(
        "--cache-dir", type=Path, metavar="DIR",
        help=f"folder that keeps roll-outs (default: ${CACHE_VARIABLE} or the user's cache folder)",
    )  # fmt: skip


def store_of(arguments: argparse.Namespace) -> Store | None:
    """The store that the options of `add_cache` ask for; None with --no-cache.

    Raises:
        OutputError: the folder of --cache-dir cannot be made.
    """
    if arguments.no_cache:
        return None
    base = folder(arguments.cache_dir) if arguments.cache_dir is not None else cache_folder()
    return Store(base / ROLL_OUTS)


def add_table(parser: argparse.ArgumentParser) -> None:
    """The arguments that name a table and, if need be, its job; `loaded` reads both."""
    parser.add_argument("tree", type=Path, metavar="TREE.msgpack", help="the table")
    parser.add_argument("--job", type=Path, help="the job file, for a table compiled with --strip")


def loaded(arguments: argparse.Namespace) -> tuple[TableFile, Job]:
    """The table of `add_table`, and the job it was compiled from: its own copy, or a file with its digest.

    Raises:
        TableError: the table cannot be used.
        JobError: there is no job, or it is another one, or it cannot be read.
    """
    found = load(arguments.tree)
    if arguments.job is None:
        if found.table.job is None:
            problem = "holds no job (--strip); name its job file with --job"
            raise InputFileError(problem, where=str(arguments.tree))
        return found, job_file.from_canonical(found.table.job, f"{arguments.tree} (embedded job)")
    job = job_file.load(arguments.job)
    if job.digest() != found.table.job_digest:
        problem = f"is not the job that {arguments.tree} was compiled from; compile it again"
        raise InputFileError(problem, where=str(arguments.job))
    return found, job


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """The options that say who works; `planner.work.scheduler.scheduler_of` takes their values."""
    parser.add_argument(
        "--workers", type=command.positive_int, help="threads; the result is the same (default: cores)"
    )
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT",
        help="work on the Dask cluster of this scheduler (default: threads of this machine)",
    )  # fmt: skip


def run(built: Parser, argv: Sequence[str] | None, body: Callable[[argparse.Namespace], int]) -> int:
    """Runs a command as `runtime.shell.command.run` does, and turns the store's warnings into a line each."""
    logging.lastResort = None  # what a library logs beside the error that it raises is not told twice
    with _warnings_in_one_line(built.prog):
        return command.run(built, argv, body, stopped=(INTERRUPTED, "interrupted; nothing was written"))


@contextmanager
def _warnings_in_one_line(name: str) -> Iterator[None]:
    """Prints what the store warns about as errors are printed, each time."""

    def show(message: Warning | str, category: type[Warning], *where: Any, **named: Any) -> None:
        if issubclass(category, StoreWarning):
            command.tell(name, f"warning: {message}")
        else:
            usual(message, category, *where, **named)

    with warnings.catch_warnings():
        usual = warnings.showwarning
        warnings.simplefilter("always", StoreWarning)
        warnings.showwarning = show
        yield


def print_json(data: dict[str, Any]) -> None:
    """One JSON object on one line."""
    print(json.dumps(data))


@contextmanager
def progress(quiet: bool) -> Iterator[Report]:
    """A progress bar on a terminal, nothing in a pipe; yields `report(stage, done, total)`.

    Each stage shows the time since it began and an estimate of the time it still takes.
    """
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield silent
        return
    columns = [
        bars.SpinnerColumn(), bars.TextColumn("{task.description}"), bars.BarColumn(),
        bars.TimeElapsedColumn(), bars.TextColumn("left:"), bars.TimeRemainingColumn(),
    ]  # fmt: skip
    with bars.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)
        stage_now = ""

        def report(stage: str, done: int, total: int) -> None:
            nonlocal stage_now
            if stage != stage_now:
                stage_now = stage
                bar.reset(task, description=stage)
            bar.update(task, completed=done, total=total)

        yield report
