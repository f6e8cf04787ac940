"""Base classes of expected errors, one for each kind of remedy.

::

    ExpectedError
     +- UsageError         2  correct the command line
     +- InputError         3  correct the file
     +- CheckFailedError  11  read the report
     +- DeviceError       20  look at the cell
     +- UnreachableError  21  connect the device, or stop the program that uses it

The number is the exit code of a command that ends with the error. `planner.errors`, `runtime.errors` and
`drivers.errors` derive further errors from these classes. The message of an error is one line: what is wrong,
where, and what to do.
"""

from typing import Self

from runtime.shell.exit_codes import ExitCode


class ExpectedError(Exception):
    """Base class of errors that people, devices or disks cause.

    Any other exception is a bug, except an OSError.
    """

    exit_code = ExitCode.INTERNAL


class UsageError(ExpectedError):
    """The command line contradicts itself, or names something unusable."""

    exit_code = ExitCode.USAGE


class InputError(ExpectedError):
    """An input file is missing, unreadable or refused.

    Args:
        problem: what is wrong, and what to do.
        where: name of the file.
        section: section of the file; "": the top level of the file.
        key: key in the section.
    """

    exit_code = ExitCode.INPUT

    def __init__(self, problem: str, *, where: str = "", section: str = "", key: str = "") -> None:
        # All but `problem` have defaults, so that the error survives pickling between worker processes.
        place = f"[{section}] {key}".strip() if section else key
        super().__init__(": ".join(part for part in (where, place, problem) if part))
        self.problem, self.where, self.section, self.key = problem, where, section, key

    def at(self, where: str = "", section: str = "", key: str = "") -> Self:
        """Returns a copy of the error with file, section and key added; those that are set already stay."""
        where, section, key = self.where or where, self.section or section, self.key or key
        return type(self)(self.problem, where=where, section=section, key=key)


class CheckFailedError(ExpectedError):
    """A check found a problem, which has already been printed."""

    exit_code = ExitCode.CHECK_FAILED


class DeviceError(ExpectedError):
    """A device reports a fault, gives an implausible reading, or must not do what was requested."""

    exit_code = ExitCode.DEVICE


class UnreachableError(ExpectedError):
    """A device, port, cell or cluster does not answer, cannot be opened, or is in use."""

    exit_code = ExitCode.UNREACHABLE


def is_expected(error: BaseException) -> bool:
    """Whether an error is one that people, devices or disks cause; any other error is a bug."""
    return isinstance(error, ExpectedError | OSError)


def exit_code_of(error: BaseException) -> ExitCode:
    """Exit code of a run that ends with an error; an OSError counts as a device that cannot be reached."""
    if isinstance(error, KeyboardInterrupt):
        return ExitCode.STOPPED
    if isinstance(error, ExpectedError):
        return error.exit_code
    return ExitCode.UNREACHABLE if is_expected(error) else ExitCode.INTERNAL
