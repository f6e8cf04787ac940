"""What every command shares: one-line errors, exit codes, types of arguments, standard output that fails.

A command is a parser and a body: `return run(parser(), argv, body)`.
"""

import argparse
import contextlib
import errno
import json
import math
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from io import TextIOWrapper
from pathlib import Path
from typing import Any, NoReturn, TextIO

from runtime.shell import output
from runtime.shell.errors import ExpectedError
from runtime.shell.exit_codes import ExitCode
from runtime.shell.plain_text import cleaned

OURS = frozenset({"planner", "runtime", "drivers"})
LONGEST_LINE = 2000
UNWRITABLE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE})

_lost: list[OSError] = []  # why lines of standard output are lost, since `run` began


class Parser(argparse.ArgumentParser):
    """An argument parser with one-line errors, help texts printed verbatim, and --print-completion."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)
        if " " not in self.prog:  # a subcommand is completed by its command
            self.add_argument(
                "--print-completion",
                action=_PrintCompletion,
                choices=("bash", "zsh", "tcsh"),
                help="print a script with which this shell completes the command by Tab",
            )

    def error(self, message: str) -> NoReturn:
        """End with exit code 2 and a line on standard error."""
        tell(self.prog, f"{message}; {self.prog} --help tells more")
        self.exit(ExitCode.USAGE)

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print the text of --help; argparse itself would not tell that it was lost."""
        say_lines(message, file or sys.stderr)

    def add_common(self, json: str = "print one JSON object instead of text") -> None:
        """Add --json, with its help, and --debug."""
        self.add_argument("--json", action="store_true", help=json)
        self.add_debug()

    def add_debug(self) -> None:
        """Add --debug alone."""
        self.add_argument("--debug", action="store_true", help="print the traceback of an error")


def add_command(
    commands: "argparse._SubParsersAction[Parser]",
    name: str,
    purpose: str,
    example: str,
    codes: str,
) -> Parser:
    """Add a subcommand, whose --help has its purpose, an example and the exit codes."""
    return commands.add_parser(
        name,
        help=purpose,
        description=f"{purpose[0].upper()}{purpose[1:]}.",
        epilog=f"example:\n  {example}\n\n{codes}",
    )


class _PrintCompletion(argparse.Action):
    """Prints the completion script of a command, which shtab writes, and exits."""

    def __call__(self, parser: Any, _namespace: Any, values: Any, _option: Any = None) -> None:
        try:
            shtab = import_module("shtab")  # of an extra
        except ModuleNotFoundError:
            parser.error(
                "--print-completion needs shtab; install squeezetree[completion]; "
                "in a clone: pip install '.[completion]'"
            )
        for action in _actions(parser):
            if action.type is Path:
                kind = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE
                action.complete = kind  # type: ignore[attr-defined]
            elif isinstance(action, argparse._SubParsersAction):
                action.help = None  # shtab leaves out what --help hides
        say_lines(shtab.complete(parser, shell=values))
        parser.exit()


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """The arguments of a parser and of its subcommands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for subparser in action.choices.values():
                yield from _actions(subparser)


def run(
    built: Parser,
    argv: Sequence[str] | None,
    body: Callable[[argparse.Namespace], int],
    stopped: tuple[int, str] = (ExitCode.INTERRUPTED, "interrupted"),
) -> int:
    """Run a command; every error becomes one line on standard error and an exit code, which is returned.

    An `ExpectedError` ends with its `exit_code`; an OSError with INPUT where a file cannot be read, with
    UNREACHABLE where a connection fails, with USAGE where an output cannot be written; any other error is a
    bug and ends with INTERNAL.
    An answer that is lost ends a command that did well with 2; a reader who has seen enough (`| head`) does
    not.

    Args:
        built: the command's parser; arguments without `debug` count as without --debug.
        argv: the arguments, without the command's name; None for the process's own.
        body: does the work and returns the exit code.
        stopped: exit code and sentence of a KeyboardInterrupt.

    Raises:
        SystemExit: of the parser, for --help and for arguments that are not understood.
    """
    closed = _open_streams()
    _lost.clear()
    try:
        arguments = built.parse_args(argv)
    except SystemExit as end:
        raise SystemExit(_flushed(built.prog, int(end.code or 0))) from None
    if closed:
        tell(built.prog, "standard output is closed; send it to a file, or to /dev/null")
        return ExitCode.USAGE
    return _flushed(built.prog, _guarded(built.prog, arguments, body, stopped))


def entry(name: str, module: str, extra: str, argv: Sequence[str] | None = None) -> int:
    """Import the module of a command and run its `main` on its arguments, None for the process's own.

    Where the module needs an extra of squeezetree that is missing, say what to install, and return 2.
    """
    try:
        loaded = import_module(module)
    except ModuleNotFoundError as error:
        missing = (error.name or module).split(".")[0]
        if missing in OURS:
            raise
        hint = f"install squeezetree[{extra}]; in a clone: pip install '.[{extra}]'"
        tell(name, f"needs the {extra} extra ({missing} is missing); {hint}")
        return ExitCode.USAGE
    except KeyboardInterrupt:
        tell(name, "interrupted")
        return ExitCode.INTERRUPTED
    return int(loaded.main(argv))


def say(line: str, file: TextIO | None = None) -> None:
    """Print a line at once, `cleaned`; that nobody reads it or the disk is full must not stop a cell.

    What standard output has lost is told by `run` at the command's end.
    """
    file = file or sys.stdout
    outlet = output.outlet_of(file)
    try:
        if outlet is None:
            print(cleaned(line), file=file, flush=True)
        else:
            outlet.put(f"{cleaned(line)}\n".encode(file.encoding, "backslashreplace"))
    except OSError as error:
        _give_up(file, error)


def say_lines(text: str, file: TextIO | None = None) -> None:
    """Print each line of a text, as `say`."""
    for line in text.removesuffix("\n").split("\n"):
        say(line, file)


def say_result(as_json: bool, fields: Mapping[str, object], lines: Iterable[str]) -> None:
    """Print what a command came to: as one JSON object, or as lines for people."""
    for line in [json.dumps(fields)] if as_json else lines:
        say(line)


def tell(name: str, words: object) -> None:
    """Print what is wrong as one line on standard error, if there is one."""
    say(f"{name}: {one_line(words)}", sys.stderr)


def sentence_of(error: BaseException) -> str:
    """An error's sentence, and in the same line what was noted on its way out."""
    return one_line(
        "; ".join([str(error) or type(error).__name__, *getattr(error, "__notes__", ())])
    )


def one_line(words: object) -> str:
    """The text of an error without line breaks and control characters, and not without end."""
    text = " ".join(str(words).split()) or type(words).__name__
    if len(text) > LONGEST_LINE:
        text = f"{text[:LONGEST_LINE]}..."
    return cleaned(text)


def positive_int(text: str) -> int:
    """An integer of at least 1, for argparse."""
    return _at_least(1, text)


def natural(text: str) -> int:
    """An integer of at least 0, for argparse."""
    return _at_least(0, text)


def number(text: str) -> float:
    """A finite number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


def positive(text: str) -> float:
    """A finite number above 0, for argparse."""
    value = number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def seconds(text: str) -> float:
    """A positive time such as 90, 90s or 1.5min, for argparse [s]."""
    if text.endswith("min"):
        return 60.0 * positive(text.removesuffix("min"))
    return positive(text.removesuffix("s"))


def _at_least(least: int, text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
    if value < least:
        raise argparse.ArgumentTypeError(f"{text!r} is less than {least}")
    return value


def _guarded(
    name: str,
    arguments: argparse.Namespace,
    body: Callable[[argparse.Namespace], int],
    stopped: tuple[int, str],
) -> int:
    try:
        return body(arguments)
    except KeyboardInterrupt:
        code, words = stopped
        tell(name, words)
        return int(code)
    except (Exception, SystemExit) as error:  # a world's factory may be any function
        if getattr(arguments, "debug", False):
            say_lines(traceback.format_exc(), sys.stderr)
        code, words = _end_of(error)
        tell(name, words)
        return int(code)


def _end_of(error: BaseException) -> tuple[int, str]:
    if isinstance(error, ExpectedError):
        return error.exit_code, sentence_of(error)
    if isinstance(error, OSError):
        reason = error.strerror or sentence_of(error)
        if error.errno in UNWRITABLE:
            _discard(sys.stdout)
            return ExitCode.USAGE, _unwritten(error)
        if error.filename is not None:
            return ExitCode.INPUT, f"{error.filename}: {reason}"
        if isinstance(error, ConnectionError | TimeoutError):
            return ExitCode.UNREACHABLE, reason
    kind = type(error).__name__
    return (
        ExitCode.INTERNAL,
        f"internal error, please report it: {kind}: {sentence_of(error)} (--debug shows more)",
    )


def _flushed(name: str, code: int) -> int:
    """The exit code, once standard output is written or known to be lost."""
    outlet = output.outlet_of(sys.stdout)
    try:
        sys.stdout.flush()
        if outlet is not None and (lines := outlet.end()):
            _lost.append(TimeoutError(errno.ETIMEDOUT, f"nobody reads it, {lines} lines are lost"))
    except OSError as error:
        _give_up(sys.stdout, error)
    if not _lost:
        return int(code)
    tell(name, _unwritten(_lost[0]))
    return int(code or ExitCode.USAGE)


def _unwritten(error: OSError) -> str:
    return f"output cannot be written: {error.strerror}; free the disk, or send it elsewhere"


def _give_up(file: TextIO, error: OSError) -> None:
    """Print nothing more to a stream, and remember what standard output has lost."""
    if file is sys.stdout and not isinstance(error, BrokenPipeError):
        _lost.append(error)
    _discard(file)


def _discard(file: TextIO) -> None:
    """Let what is still to be printed go nowhere: Python flushes on its way out, and would complain then."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError):  # a stream in memory has no descriptor
        os.dup2(nowhere, file.fileno())
    os.close(nowhere)


def _open_streams() -> bool:
    """Open those of the three standard streams that are closed, onto nothing; returns whether the second was.

    Otherwise the next file that is opened would take its number, and be written with what others print.
    """
    closed = []
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest number that is free is this one
            closed.append(descriptor)
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may hold any bytes
        # with PYTHONUNBUFFERED, too, an answer is lost at the end, not half-way
        if not sys.stdout.isatty():
            sys.stdout.reconfigure(write_through=False)
    return 1 in closed
