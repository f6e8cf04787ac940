"""Errors of the cell controller, derived from the general errors in `runtime.shell.errors`."""

from pathlib import Path

from runtime.shell.errors import DeviceError, ExpectedError, InputError
from runtime.shell.exit_codes import ExitCode


class TableError(InputError):
    """A table must not be executed: its file is missing, damaged, of another format, or invalid."""


class JournalError(ExpectedError):
    """The journal cannot be read or written, was moved or truncated, or one of its lines does not verify.

    Args:
        path: path of the journal.
        reason: what is wrong, and what to do.
        line: number of the wrong line, from 1; None if no single line is wrong.
    """

    exit_code = ExitCode.JOURNAL

    def __init__(self, path: Path, reason: str, line: int | None = None) -> None:
        where = f"journal {path}" if line is None else f"journal {path}, line {line}"
        super().__init__(f"{where}: {reason}")
        self.line = line


class TornError(JournalError):
    """The last line of a journal is incomplete: a crash cut it short, before any action followed from it."""


class BrokenRunError(ExpectedError):
    """The last run broke off and may not be continued: the policy or the state of the cell forbids that."""

    exit_code = ExitCode.JOURNAL


class GripperStateError(DeviceError):
    """The gripper is not ready, reports a fault, or gave a reading that cannot be trusted."""


class MotionRefusedError(DeviceError):
    """A motion is refused before it is sent, or the arm was displaced or took too long."""


class PackError(ExpectedError):
    """A signed pack is refused, or no pack holds the table and the calibration of a run."""

    exit_code = ExitCode.SIGNATURE
