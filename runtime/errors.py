"""Errors of the cell controller.

Every class carries `exit_code`, the process exit code of the command that ends with it: decision 0003 lists
them. Errors of the drivers are known to the runtime by their built-in parents and by the module of their
class.
"""

from pathlib import Path

DRIVERS = "drivers.errors"


class CellError(Exception):
    """Base of every error the cell controller raises on purpose; `exit_code` is the command's exit code."""

    exit_code = 1


class TableFileError(CellError):
    """The table file is missing or unreadable: a wrong path, a directory, no permission."""

    exit_code = 3

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"table {path}: {reason}")


class TableError(CellError):
    """A table that must not be executed: damaged, of another format, or not valid."""

    exit_code = 30


class JournalError(CellError):
    """The journal cannot be written, was moved or cut, or its line (from 1) does not verify."""

    exit_code = 24

    def __init__(self, path: Path, reason: str, line: int | None = None) -> None:
        where = f"journal {path}" if line is None else f"journal {path}, line {line}"
        super().__init__(f"{where}: {reason}")
        self.line = line


class TornError(JournalError):
    """The last line of a journal is not whole: a crash cut it short, and nothing was done upon it."""


class PortBusyError(CellError):
    """Another process of ours works with the same device; two of them would interleave their motions."""

    exit_code = 23


class BrokenRunError(CellError):
    """The last run broke off, and the declared policy or the state of the cell forbids resuming it."""

    exit_code = 25


class CellCheckError(CellError):
    """A check of the cell failed; the sentences above it say what to do."""

    exit_code = 26


class CalibrationError(CellError):
    """A calibration file is refused: not readable, not monotone, of another gripper, or unfit for a table."""

    exit_code = 33


class GripperStateError(CellError):
    """The gripper is not ready, reports a fault, or gave a reading that cannot be trusted."""

    exit_code = 21


class MotionRefusedError(CellError):
    """A motion that the safety checks refused before it was sent."""

    exit_code = 22


class KeyFileError(CellError):
    """A key file cannot be read, may be read by others, or holds no key of the kind that is asked for."""

    exit_code = 3

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"key {path} {reason}")


class PackFileError(CellError):
    """A pack's file cannot be read."""

    exit_code = 3


class PackError(CellError):
    """A pack is refused, or none vouches for what a run is about to use."""

    exit_code = 34


class CellStartError(CellError):
    """The simulated cell ended, or stayed silent, before it told its endpoints."""

    exit_code = 31


class ArgumentsError(CellError):
    """Arguments that argparse alone cannot judge: they contradict one another, or cannot be used."""

    exit_code = 2


class PartRejectedError(CellError):
    """A part was rejected: nothing between the fingers, or a width that no outcome of the squeeze has."""

    exit_code = 10


class PartUnresolvedError(CellError):
    """A part ended at a leaf that the table does not call resolved."""

    exit_code = 11


class PartNotDeliveredError(CellError):
    """A part was localised, but could not be taken at its pose, or not be carried away; it was left there."""

    exit_code = 12


class StoppedError(CellError):
    """The operator stopped the run; the cell was left in the declared safe state."""

    exit_code = 40


def exit_code_of(error: BaseException) -> int:
    """Exit code of a command that ends with an error: its class's, its built-in parent's, or 1 for a bug."""
    if isinstance(error, KeyboardInterrupt):
        return StoppedError.exit_code
    if not is_expected(error):
        return 1
    codes = (vars(kind)["exit_code"] for kind in _listed(error) if "exit_code" in vars(kind))
    return next(codes, 20)


def is_expected(error: BaseException) -> bool:
    """Whether an error is one that devices, disk or people make, and no bug: by its class."""
    return isinstance(error, CellError | OSError) or bool(_listed(error))


def _listed(error: BaseException) -> list[type]:
    """The classes of an error that this module or `drivers.errors`, which runtime does not import, lists."""
    return [kind for kind in type(error).__mro__ if kind.__module__ in (__name__, DRIVERS)]
