"""What can go wrong in planning, sorted by what the reader has to do about it.

    PlannerError                     1   a bug of ours, unless it is one of these
    ├── UsageError                   2   a command-line value that argparse alone cannot judge
    ├── JobError                         the job file; carries file, section, key and value
    │   ├── InputFileError           3   missing, unreadable, a directory, not UTF-8
    │   ├── TomlError                4   not valid TOML (or, inside a table, not valid JSON)
    │   ├── KeyNameError             5   unknown or missing key or section
    │   ├── ValueRangeError          6   wrong type, out of range, or in conflict with another value
    │   ├── OutlineError             7   the outline is not a simple polygon
    │   └── FitError                 8   the part does not fit between the open fingers
    ├── NoPlanError                  9   no tree of squeezes reaches the goal
    └── ClusterError                32   the cluster of `--scheduler` cannot be reached, or was lost

The number is the exit code of every `plan-*` command. A message is one line: where, what, what to do.
"""

from __future__ import annotations

from typing import Self


class PlannerError(Exception):
    """Base of all errors that `planner` raises on purpose."""

    exit_code = 1


class UsageError(PlannerError):
    """A command-line value cannot be used, such as a `--world` that names no factory."""

    exit_code = 2


class JobError(PlannerError):
    """The job file cannot be used as it stands.

    Attributes:
        problem: what is wrong and what to do, without the place.
        where: the file, or what stands for it.
        section: section of the file, "" for the top level or the file as a whole.
        key: key in the section, "" if the section as a whole is meant.
        value: what was found there.
    """

    def __init__(
        self, problem: str, *, where: str = "", section: str = "", key: str = "", value: object = None
    ) -> None:
        # All but `problem` have defaults, so that the error survives pickling between worker processes.
        place = f"[{section}] {key}".strip() if section else key
        super().__init__(": ".join(part for part in (where, place, problem) if part))
        self.problem = problem
        self.where = where
        self.section = section
        self.key = key
        self.value = value

    def at(self, where: str, section: str, key: str) -> Self:
        """Return the same error with its place in the file added."""
        return type(self)(self.problem, where=where, section=section, key=key, value=self.value)


class InputFileError(JobError):
    """The file is not there, may not be read, is a directory, or is not UTF-8 text."""

    exit_code = 3


class TomlError(JobError):
    """The text is not valid TOML: a bracket missing, a key written twice.

    Attributes:
        line: line of the mistake, from 1; 0 if the parser does not say.
        column: column of the mistake, from 1; 0 if the parser does not say.
    """

    exit_code = 4
    line = 0
    column = 0


class KeyNameError(JobError):
    """A key or section is not known here, or one that must be stated is missing.

    Attributes:
        names: the unknown name, or all the missing ones.
    """

    exit_code = 5
    names: tuple[str, ...] = ()


class ValueRangeError(JobError):
    """A value has the wrong type, lies outside its range, or contradicts another value."""

    exit_code = 6


class OutlineError(JobError):
    """The outline is not a simple polygon: too few vertices, a repeated point, a crossing."""

    exit_code = 7


class FitError(JobError):
    """The part is wider, even across its narrowest side, than the jaws open."""

    exit_code = 8


class NoPlanError(PlannerError):
    """The search ended without a tree that reaches the goal.

    Attributes:
        success: the best success rate found, 0 to 1.
    """

    exit_code = 9
    success = 0.0


class ClusterError(PlannerError):
    """The Dask cluster of `--scheduler` does not answer, has no workers or was lost half-way."""

    exit_code = 32
