"""Shared parts of the planner's commands: exit codes, options, output, progress; see also `runtime.shell`."""

import argparse
import contextlib
import json
import logging
import os
import signal
import textwrap
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from planner.cli import course
from planner.job import model as job_file
from planner.job.model import Job
from planner.part.importers.pieces import TOLERANCE_MM, UNITS_MM, Options
from planner.work.limit import Limit
from planner.work.scheduler import Scheduler, scheduler_of
from runtime.shell import command
from runtime.shell.command import Parser
from runtime.shell.errors import ExpectedError, InputError, UsageError
from runtime.shell.exit_codes import ExitCode, epilog
from runtime.table import Table, TableFile, load

progress = course.shown
WIDTH = 98  # columns of --help
PICTURES = (".png", ".svg", ".pdf")  # suffixes of pictures that matplotlib writes
STOPPING = "stopping: the best tree so far is evaluated and kept; Ctrl-C again ends at once"
EXIT_CODES = epilog(ExitCode.INPUT, ExitCode.NO_PLAN, ExitCode.UNREACHABLE)


def parser(name: str, description: str, *examples: str) -> Parser:
    """An argument parser with the options and the epilogue of all commands."""
    shown = "\n  ".join(examples)
    text = textwrap.fill(description, WIDTH)
    epilog = f"example{'s' * (len(examples) > 1)}:\n  {shown}\n\n{EXIT_CODES}"
    result = Parser(prog=name, description=text, epilog=epilog)
    result.add_common()
    return result


def thickness_of(solid_mm: float | None, stated_mm: float | None) -> float | None:
    """The height of a part: as stated, but at least that of the solid, over which the hand has to pass.

    Arguments are None if the drawing is no solid, or nothing is stated; the result is None if both are.
    """
    return max((mm for mm in (solid_mm, stated_mm) if mm is not None), default=None)


def refuse(problems: Iterator[str]) -> None:
    """Raises a `UsageError` for the first problem of a command line, if there is any."""
    for problem in problems:
        raise UsageError(problem)


def check_suffix(option: str, path: Path, suffixes: Sequence[str]) -> None:
    """Checks the suffix of the path that an option names.

    Raises:
        UsageError: the path ends in none of `suffixes`.
    """
    if path.suffix.lower() not in suffixes:
        raise UsageError(f"{option} {path} must end in {', '.join(suffixes)}")


def add_drawing(group: argparse._ArgumentGroup) -> None:
    """Adds the options that say how to read a drawing; `drawing_of` reads them."""
    add = group.add_argument
    add("--units", choices=UNITS_MM, help="unit of the drawing (default: as the file says)")
    text = "size of one unit in mm, for a drawing in pixels"
    add("--scale", type=command.positive, metavar="MM", help=text)
    text = "the layer of a DXF drawing to read (default: all visible ones)"
    add("--layer", metavar="NAME", help=text)
    text = "number of the contour, if there are several"
    add("--contour", type=command.positive_int, metavar="N", help=text)
    text = "greatest distance of the polygon from a curve (default: %(default)s)"
    number: dict[str, Any] = {"type": command.number, "metavar": "MM"}
    add("--tolerance", dest="tolerance_mm", default=TOLERANCE_MM, help=text, **number)
    text = "height at which the finger tips meet an STL solid (default: half-way up, at most 8)"
    add("--height", dest="height_mm", help=text, **number)


def drawing_of(arguments: argparse.Namespace) -> Options:
    """Returns the values of the options that `add_drawing` added."""
    return Options(**{name: getattr(arguments, name) for name in Options._fields})


def add_table(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments for a table, and for the job of a table that holds none; `loaded` reads both."""
    parser.add_argument("tree", type=Path, metavar="TREE.msgpack", help="the table")
    parser.add_argument("--job", type=Path, help="the job file, for a table compiled with --strip")


def loaded(arguments: argparse.Namespace) -> tuple[TableFile, Job]:
    """Loads the table that the arguments of `add_table` name, and the job of this table.

    The job is the copy in the table or, with --job, a file with the same digest.

    Raises:
        TableError: the table cannot be used.
        InputError: the job is missing or unreadable, or is not the job of the table.
    """
    result = load(arguments.tree)
    if arguments.job is None:
        if result.table.job is None:
            problem = "holds no job (--strip); name its job file with --job"
            raise InputError(problem, where=str(arguments.tree))
        return result, job_file.from_canonical(result.table.job, f"{arguments.tree} (embedded job)")
    job = job_file.load(arguments.job)
    if job.digest() != result.table.job_digest:
        problem = f"is not the job that {arguments.tree} was compiled from; compile it again"
        raise InputError(problem, where=str(arguments.job))
    return result, job


def check_one_part(several: object, name: str, what: str) -> None:
    """Refuses several hypotheses where a command handles one part only.

    `several` are the hypotheses of a job or table, if any. `name` is its file, and `what` the command's work;
    both are for the message.

    Raises:
        UsageError: there are several hypotheses.
    """
    if several:
        raise UsageError(f"{what} is for one part, but {name} leaves open which part it is")


def check_squeezes_alone(table: Table, name: str, what: str) -> None:
    """Refuses tables with pushes where a command handles squeezes only.

    `name` is the table's file, and `what` the command's work; both are for the message.

    Raises:
        UsageError: parts are pushed before some squeeze.
    """
    if table.pushing is not None:
        remedy = 'plan with actions.pushes = "none"'
        message = f"{remedy}; {name} pushes before node {table.pushing}"
        raise UsageError(f"{what} is for squeezes alone; {message}")


def add_output(
    parser: argparse.ArgumentParser, metavar: str, what: str, required: bool = True
) -> None:
    """Adds the option for the file or folder to write."""
    add = parser.add_argument
    add("-o", "--output", type=Path, required=required, metavar=metavar, help=what)


def add_seed(parser: argparse.ArgumentParser, what: str) -> None:
    """Adds the option for the seed of a command's random draws, 0 by default."""
    text = f"seed {what} (default: %(default)s)"
    parser.add_argument("--seed", type=command.natural, default=0, help=text)


def add_trials(parser: argparse.ArgumentParser, default: int, what: str) -> None:
    """Adds the option for the number of simulated parts."""
    text = f"{what} (default: %(default)s)"
    parser.add_argument("--trials", type=command.positive_int, default=default, help=text)


def add_distance(group: argparse._ArgumentGroup) -> None:
    """Adds the option --distance, the goal of a new job: the greatest error of a located part."""
    text = "greatest error of a part that counts as located (default: %(default)s)"
    group.add_argument("--distance", type=command.number, default=3.0, metavar="MM", help=text)


def add_takt(parser: argparse.ArgumentParser) -> None:
    """Adds the option --takt: the time [s] within which a part should be done."""
    text = "also state how many parts are done within this time"
    parser.add_argument("--takt", type=command.seconds, metavar="6s", help=text)


def add_scheduler(parser: argparse.ArgumentParser) -> None:
    """Adds the options for workers; `scheduler` reads them."""
    text = "threads; the result is the same (default: cores)"
    parser.add_argument("--workers", type=command.positive_int, help=text)
    text = "work on the Dask cluster of this scheduler (default: threads of this machine)"
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help=text)


def scheduler(arguments: argparse.Namespace) -> AbstractContextManager[Scheduler]:
    """Context manager of the workers that the options of `add_scheduler` ask for.

    See `planner.work.scheduler.scheduler_of`.
    """
    return scheduler_of(arguments.scheduler, arguments.workers)


Body = Callable[[argparse.Namespace], int | None]


def main_of(parser: Callable[[], Parser], body: Body) -> Callable[..., int]:
    """Returns the function `main` of a command; `body` does the work.

    `main` takes the arguments (None: those of the process), and returns the exit code.
    """
    return lambda argv=None: run(parser(), argv, body)


def run(built: Parser, argv: Sequence[str] | None, body: Body) -> int:
    """Runs a command as `runtime.shell.command.run` does; a body that returns None succeeded."""
    # A library's log of the error that it raises would repeat the message.
    logging.lastResort = None
    stopped = ExitCode.INTERRUPTED, "interrupted; nothing was written"
    return command.run(built, argv, lambda arguments: body(arguments) or 0, stopped)


def answer(as_json: bool, figures: Mapping[str, Any], *lines: str) -> None:
    """Prints the result of a command: its figures as one JSON object on one line, or lines for people."""
    print(json.dumps(figures) if as_json else "\n".join(lines))


def printer(as_json: bool) -> Callable[..., None]:
    """Returns `print` for an answer to people; for a JSON answer, a function that prints nothing."""
    return (lambda *_lines, **_options: None) if as_json else print


@contextmanager
def spared(what: str, notes: list[str], debug: bool = False) -> Iterator[None]:
    """Context of optional work: catches an exception or Ctrl-C, and adds a note on it to `notes`.

    Args:
        what: a noun for the work, used in the note.
        notes: the list to which the note is added.
        debug: whether to print the traceback, too.
    """
    try:
        yield
    except KeyboardInterrupt:
        notes.append(f"interrupted: no {what}")
    except Exception as error:
        if debug:
            traceback.print_exc()
        reason = error if isinstance(error, ExpectedError) else f"{type(error).__name__}: {error}"
        notes.append(f"no {what}: {command.one_line(reason)}")


@contextmanager
def _on_interrupt(hear: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Context in which the function `hear` handles Ctrl-C."""
    usual = signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)


@contextmanager
def stopping(limit: Limit, name: str) -> Iterator[None]:
    """Context in which the first Ctrl-C ends the work of a command with the result so far.

    A further Ctrl-C, or one before there is any result, interrupts the command.
    """

    def hear(number: int, frame: FrameType | None) -> None:
        if not limit.ask():
            signal.default_int_handler(number, frame)
        # Not through sys.stderr, which may be in the middle of a line.
        with contextlib.suppress(OSError):
            os.write(2, f"{name}: {STOPPING}\n".encode())

    with _on_interrupt(hear):
        yield


@contextmanager
def compiling() -> Iterator[None]:
    """Context for work that may compile kernels: Ctrl-C raises KeyboardInterrupt, even if numba hides it."""
    heard = False

    def hear(number: int, frame: FrameType | None) -> None:
        nonlocal heard
        heard = True
        signal.default_int_handler(number, frame)

    with _on_interrupt(hear):
        try:
            yield
        except Exception:
            if not heard:
                raise
    if heard:
        raise KeyboardInterrupt
