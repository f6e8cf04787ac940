"""What all planner commands share: one-line errors, exit codes, Ctrl-C, progress."""

from __future__ import annotations

import argparse
import json
import math
import sys
import textwrap
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from planner.errors import InputFileError, PlannerError
from planner.kernel import CACHE_VARIABLE, cache_folder
from planner.learned.store import Store, StoreWarning
from planner.progress import Report, silent
from runtime.table import TableError, TableFileError

INTERRUPTED = 130
WIDTH = 98
"""Columns of what --help says."""
ROLL_OUTS = "rollouts"
"""Folder of the roll-outs in the cache folder."""
EXIT_CODES = """\
exit codes:
  0 done; 1 internal error; 2 usage; 3 input file missing or unreadable; 4 not valid TOML; 5 unknown or
  missing key; 6 value out of range; 7 outline invalid; 8 part does not fit the gripper; 9 no plan reaches
  the goal; 30 table invalid; 32 cluster not reached or lost; 130 interrupted (nothing is left half written)
"""


def parser(name: str, description: str, *examples: str) -> argparse.ArgumentParser:
    """An argument parser with the options and the epilogue that all commands have."""
    shown = "\n  ".join(examples)
    result = argparse.ArgumentParser(
        prog=name,
        description=textwrap.fill(description, WIDTH),
        epilog=f"example{'s' * (len(examples) > 1)}:\n  {shown}\n\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    result.add_argument("--debug", action="store_true", help="print the traceback of an error")
    return result


def positive(text: str) -> int:
    """An integer of at least 1, for argparse."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is less than 1")
    return value


def natural(text: str) -> int:
    """An integer of at least 0, for argparse."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError(f"{value} is negative")
    return value


def seconds(text: str) -> float:
    """A positive time such as 90, 90s or 1.5min, for argparse [s]."""
    number, unit = text.removesuffix("s"), 1.0
    if text.endswith("min"):
        number, unit = text.removesuffix("min"), 60.0
    value = float(number) * unit
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a time above zero")
    return value


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
        InputFileError: the folder of --cache-dir cannot be made.
    """
    if arguments.no_cache:
        return None
    base = folder(arguments.cache_dir) if arguments.cache_dir is not None else cache_folder()
    return Store(base / ROLL_OUTS)


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """The option that moves the work to a cluster; `planner.scheduler.scheduler_of` takes its value."""
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT",
        help="work on the Dask cluster of this scheduler (default: threads of this machine)",
    )  # fmt: skip


def run(name: str, debug: bool, body: Callable[[], int]) -> int:
    """Runs a command's body; turns warnings and what goes wrong into one line each, and an exit code."""
    try:
        with _warnings_in_one_line(name):
            return body()
    except KeyboardInterrupt:
        print(f"{name}: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except (PlannerError, TableError, TableFileError) as error:
        code, message = error.exit_code, str(error)
    except OSError as error:
        code, message = InputFileError.exit_code, f"{error.filename or 'file'}: {error.strerror}"
    except Exception as error:
        code = PlannerError.exit_code
        message = f"internal error, {type(error).__name__}: {error}; please report it with --debug"
    if debug:
        traceback.print_exc()
    print(f"{name}: {message}", file=sys.stderr)
    return code


@contextmanager
def _warnings_in_one_line(name: str) -> Iterator[None]:
    """Prints what the store warns about as errors are printed, each time."""

    def show(
        message: Warning | str, category: type[Warning], filename: str, lineno: int,
        file: TextIO | None = None, line: str | None = None,
    ) -> None:  # fmt: skip
        if issubclass(category, StoreWarning):
            print(f"{name}: warning: {message}", file=sys.stderr)
        else:
            usual(message, category, filename, lineno, file, line)

    with warnings.catch_warnings():
        usual = warnings.showwarning
        warnings.simplefilter("always", StoreWarning)
        warnings.showwarning = show
        yield


def writable(path: Path) -> Path:
    """Checks that an output file could be written, before the work is done.

    Raises:
        InputFileError: its folder does not exist, or it is a folder itself.
    """
    if path.is_dir():
        raise InputFileError("is a folder; name a file", where=str(path))
    if not path.parent.is_dir():
        raise InputFileError(f"the folder {path.parent} does not exist; create it", where=str(path))
    return path


def folder(path: Path) -> Path:
    """Makes a folder for output files, before the work is done.

    Raises:
        InputFileError: it cannot be made, or there is a file of that name.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputFileError(
            f"cannot be made: {error.strerror}; name another folder", where=str(path)
        ) from error
    return path


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yields a name beside `path` to write to; it takes its place when all went well, whole or not at all.

    Raises:
        InputFileError: the disk is full, or the folder may not be written to.
    """
    draft = path.with_name(f".{path.name}.part")
    try:
        yield draft
        draft.replace(path)
    except OSError as error:
        problem = f"cannot be written: {error.strerror}; free the disk or name another file"
        raise InputFileError(problem, where=str(path)) from error
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


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
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(),
        TextColumn("left:"), TimeRemainingColumn(),
    ]  # fmt: skip
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=None)
        stage_now = ""

        def report(stage: str, done: int, total: int) -> None:
            nonlocal stage_now
            if stage != stage_now:
                stage_now = stage
                bar.reset(task, description=stage)
            bar.update(task, completed=done, total=total)

        yield report
