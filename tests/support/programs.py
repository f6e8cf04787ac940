"""Runs the project's programs for tests, in this process or in others, and waits for conditions."""

import contextlib
import importlib.util
import io
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, Self, TypeVar

WAIT_S = 120.0  # generous: the machine may have other work
ROOT = Path(__file__).parents[2]
TREES = ROOT / "trees"
JOB, TABLE = (TREES / "rectangle" / name for name in ("job.toml", "rectangle.msgpack"))
RUNTIME, CELL = ((sys.executable, "-m", name) for name in ("runtime.cli", "drivers.sim.cli"))
REHEARSAL = ("--world", "runtime.devices.rehearsal:make")
VIRTUAL = ("--port", "sim", "--time-scale", "max")  # a simulated cell in virtual time

T = TypeVar("T")


def until(holds: Callable[[], T], what: object = "", pause_s: float = 0.01) -> T:
    """Calls `holds` again and again until it returns a true value; returns this value.

    Raises:
        AssertionError: `holds` returned no true value within `WAIT_S`; the message names `what`.
    """
    end = time.monotonic() + WAIT_S
    while not (result := holds()):
        assert time.monotonic() < end, f"not within {WAIT_S:g} s: {what}"
        time.sleep(pause_s)
    return result


def module_at(path: Path) -> ModuleType:
    """Imports and returns the module of a file that belongs to no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    result = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(result)
    return result


class Closing:
    """A base class of objects that are closed at the end of a `with`."""

    def close(self) -> None:
        """Frees the resources of the object; does nothing here."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Ended(NamedTuple):
    """How a program ended: its exit code and what it printed."""

    code: int
    out: str
    err: str

    @property
    def one_line(self) -> bool:
        """Whether standard error is a single line, not a traceback."""
        return self.err.count("\n") == 1 and "Traceback" not in self.err


def called(main: Callable[[list[str]], Any], *words: object) -> Ended:
    """Calls the main function of a program in this process; returns how it ended."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = main([str(word) for word in words])
        except SystemExit as end:
            code = end.code
    return Ended(code, out.getvalue(), err.getvalue())


def document(main: Callable[[list[str]], Any], *words: object) -> Any:
    """Calls the main function of a program; returns the JSON that it prints, and asserts exit code 0."""
    ended = called(main, *words)
    assert ended.code == 0, ended
    return json.loads(ended.out)


def started(words: Iterable[object], **options: Any) -> "subprocess.Popen[str]":
    """Starts a process whose output goes to pipes, unless options of `Popen` say otherwise."""
    streams = {"cwd": ROOT, "text": True, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([str(word) for word in words], **(streams | options))


def ended(words: Iterable[object], **options: Any) -> Ended:
    """Runs a process, `WAIT_S` at most, and returns how it ended; takes options of `subprocess.run`."""
    usual = {"cwd": ROOT, "text": True, "capture_output": True, "timeout": WAIT_S, "check": False}
    done = subprocess.run([str(word) for word in words], **(usual | options))
    return Ended(done.returncode, done.stdout, done.stderr)
