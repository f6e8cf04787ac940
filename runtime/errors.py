"""Errors of the cell controller; `runtime.shell.errors` has the general ones."""

from pathlib import Path

from runtime.shell.errors import DeviceError, ExpectedError, InputError
from runtime.shell.exit_codes import ExitCode


class TableError(InputError):
    """A table that must not be executed: missing, damaged, of another format, or invalid."""


class JournalError(ExpectedError):
    """The journal cannot be written, was moved or truncated, or one of its lines does not verify.

    `line` is the number of that line, from 1.
    """

    exit_code = ExitCode.JOURNAL

    def __init__(self, path: Path, reason: str, line: int | None = None) -> None:
        where = f"journal {path}" if line is None else f"journal {path}, line {line}"
        super().__init__(f"{where}: {reason}")
        self.line = line


class TornError(JournalError):
    """The last line of a journal is incomplete: a crash cut it short, before anything followed from it."""


class BrokenRunError(ExpectedError):
    """The last run broke off, and the policy or the state of the cell forbids resuming it."""

    exit_code = ExitCode.JOURNAL


class GripperStateError(DeviceError):
    """The gripper is not ready, reports a fault, or gave a reading that cannot be trusted."""


class MotionRefusedError(DeviceError):
    """A motion is refused before it is sent, or the arm was displaced or took too long."""


class PackError(ExpectedError):
    """A pack is refused, or no pack covers the software of a run."""

    exit_code = ExitCode.SIGNATURE
