"""Runs commands: parses arguments, prints results and one-line errors, returns exit codes.

A command is a parser and a body, which does the work: `return run(parser(), argv, body)`.
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
from typing import Any, NoReturn, TextIO, TypeAlias

from runtime.shell import output
from runtime.shell.errors import ExpectedError
from runtime.shell.exit_codes import ExitCode
from runtime.shell.plain_text import capital, cleaned

OURS = frozenset({"planner", "runtime", "drivers"})
INTERRUPTED = ExitCode.INTERRUPTED, "interrupted"
LONGEST_LINE = 2000
MOST = 10**9  # largest number that counts something
UNWRITABLE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EPIPE})

_lost: list[OSError] = []  # errors by which standard output has lost lines since `run` began


class Parser(argparse.ArgumentParser):
    """An argument parser that prints errors on one line, and help texts as they are written.

    The option --print-completion prints a script with which a shell completes the command by Tab.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(formatter_class=argparse.RawDescriptionHelpFormatter, **settings)
        if " " not in self.prog:  # the script of a command also completes its subcommands
            self.add_argument(
                "--print-completion",
                action=_PrintCompletion,
                choices=("bash", "zsh", "tcsh"),
                help="print a script with which this shell completes the command by Tab",
            )

    def error(self, message: str) -> NoReturn:
        """Prints an error as one line on standard error, and exits with code 2."""
        tell(self.prog, f"{message}; {self.prog} --help tells more")
        self.exit(ExitCode.USAGE)

    def _print_message(self, message: str, file: Any = None) -> None:
        """Prints a text of argparse, such as --help, with `say_lines`, so that `run` notices lost output."""
        say_lines(message, file or sys.stderr)

    def add_common(self, json: str = "print one JSON object instead of text") -> None:
        """Adds the options --json and --debug; `json` is the help text of --json."""
        self.add_argument("--json", action="store_true", help=json)
        self.add_debug()

    def add_debug(self) -> None:
        """Adds the option --debug, but not --json."""
        self.add_argument("--debug", action="store_true", help="print the traceback of an error")


Body = Callable[[argparse.Namespace], int]
Commands: TypeAlias = "argparse._SubParsersAction[Parser]"


def add_command(commands: Commands, purpose: str, example: str, codes: str) -> Parser:
    """Adds a subcommand to a command; returns the subcommand's parser.

    Args:
        commands: the subcommands that the command has so far.
        purpose: a phrase for the lists of subcommands; the subcommand's --help begins with it.
        example: a command line for --help; its second word names the subcommand.
        codes: the section of --help with the exit codes.
    """
    return commands.add_parser(
        example.split()[1],
        help=purpose,
        description=f"{capital(purpose)}.",
        epilog=f"example:\n  {example}\n\n{codes}",
    )


class _PrintCompletion(argparse.Action):
    """The action of --print-completion: prints the script, which the package shtab generates, and exits."""

    def __call__(self, parser: Any, _namespace: Any, values: Any, _option: Any = None) -> None:
        try:
            shtab = import_module("shtab")  # an extra installs it
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
                action.help = None  # shtab omits options that --help hides
        say_lines(shtab.complete(parser, shell=values))
        parser.exit()


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yields the arguments of a parser and of its subcommands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for subparser in action.choices.values():
                yield from _actions(subparser)


def run(
    built: Parser, argv: Sequence[str] | None, body: Body, stopped: tuple[int, str] = INTERRUPTED
) -> int:
    """Runs a command; returns its exit code. Every error is printed as one line on standard error.

    The exit code after an `ExpectedError` is the error's `exit_code`. After an OSError the exit code is INPUT
    if a file cannot be read, UNREACHABLE if a connection fails, and USAGE if an output cannot be written. Any
    other error is a bug, with the code INTERNAL. If a successful command's output is lost, the code is USAGE,
    unless the reader closed the pipe (`| head`).

    Args:
        built: the command's parser. With its option --debug, tracebacks are printed, too.
        argv: the arguments, without the command's name; None: those of the process.
        body: does the work and returns the exit code.
        stopped: exit code and message for a KeyboardInterrupt. Notes of the exception follow the message.

    Raises:
        SystemExit: by the parser, for --help and for invalid arguments.
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
    try:
        code = body(arguments)
    except KeyboardInterrupt as request:
        code, words = stopped
        request.args = (words,)
        tell(built.prog, sentence_of(request))
    except (Exception, SystemExit) as error:  # a world's factory may be any function
        if getattr(arguments, "debug", False):
            say_lines(traceback.format_exc(), sys.stderr)
        code, words = _end_of(error)
        tell(built.prog, words)
    return _flushed(built.prog, code)


def entry(name: str, module: str, extra: str, argv: Sequence[str] | None = None) -> int:
    """Imports the module of a command and calls its `main`; returns the exit code.

    If a package that the module imports is not installed, prints which extra to install, and returns 2.

    Args:
        name: name of the command, for messages.
        module: name of the module.
        extra: the extra of squeezetree that installs the packages which the module imports.
        argv: the arguments of the command; None: those of the process.
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
    """Prints a line at once, with unprintable characters escaped (`cleaned`).

    If the line cannot be printed, raises no OSError, since lost output must not stop a cell. If standard
    output lost lines, `run` reports this at the command's end.

    Args:
        line: the line, without a line break at its end.
        file: the stream; None: standard output.
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
    """Prints each line of a text with `say`."""
    for line in text.removesuffix("\n").split("\n"):
        say(line, file)


def say_result(as_json: bool, fields: Mapping[str, object], lines: Iterable[str]) -> None:
    """Prints a command's result: `fields` as one JSON object if `as_json`, else `lines` for people."""
    for line in [json.dumps(fields)] if as_json else lines:
        say(line)


def tell(name: str, words: object) -> None:
    """Prints an error or a note as one line on standard error: the command's name, then `words`."""
    say(f"{name}: {one_line(words)}", sys.stderr)


def sentence_of(error: BaseException) -> str:
    """An error's message and its notes, joined into one line."""
    words = [str(error) or type(error).__name__, *getattr(error, "__notes__", ())]
    return one_line("; ".join(words))


def one_line(words: object) -> str:
    """Converts an error, or any object, to text on one line, without control characters; cuts a long text."""
    text = " ".join(str(words).split()) or type(words).__name__
    if len(text) > LONGEST_LINE:
        text = f"{text[:LONGEST_LINE]}..."
    return cleaned(text)


def positive_int(text: str) -> int:
    """Parses an integer from 1 to `MOST`, for argparse."""
    value = _at_least(1, text)
    if value > MOST:
        raise argparse.ArgumentTypeError(f"{text!r} is more than {MOST}")
    return value


def natural(text: str) -> int:
    """Parses an integer of at least 0, for argparse."""
    return _at_least(0, text)


def number(text: str) -> float:
    """Parses a finite number, for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


def named_path(text: str) -> Path:
    """Parses the path of a file, for argparse; "", "." and "/" name none."""
    path = Path(text)
    if not path.name:
        raise argparse.ArgumentTypeError(f"{text!r} is no name of a file")
    return path


def positive(text: str) -> float:
    """Parses a finite number above 0, for argparse."""
    value = number(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def seconds(text: str) -> float:
    """Parses a positive time such as "90", "90s" or "1.5min", for argparse; returns seconds."""
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


def _end_of(error: BaseException) -> tuple[int, str]:
    """Returns the exit code and the message of a command that ends with an error."""
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
    """Flushes standard output at a command's end, and reports lost output; returns the exit code.

    Args:
        name: name of the command.
        code: the exit code so far. A code of 0 becomes USAGE if output was lost; other codes stay.
    """
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
    """Discards all further output to a stream, after an error in writing to it.

    An error of standard output is remembered for `run`, unless the reader has closed the pipe.
    """
    if file is sys.stdout and not isinstance(error, BrokenPipeError):
        _lost.append(error)
    _discard(file)


def _discard(file: TextIO) -> None:
    """Redirects a stream to /dev/null, so that Python can flush its buffer at exit without an error."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError):  # a stream in memory has no descriptor
        os.dup2(nowhere, file.fileno())
    os.close(nowhere)


def _open_streams() -> bool:
    """Connects closed standard streams to /dev/null; returns whether standard output was closed.

    If a standard stream stayed closed, the next file to be opened would get the stream's number, and what is
    printed would go into this file.
    """
    closed = []
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is `descriptor`
            closed.append(descriptor)
    sys.stdin = sys.stdin or open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files may hold any bytes
        # Buffered, even with PYTHONUNBUFFERED: a print that fails in the middle would end the command there.
        if not sys.stdout.isatty():
            sys.stdout.reconfigure(write_through=False)
    return 1 in closed
