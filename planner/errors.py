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

from typing import Self


class PlannerError(Exception):
    """Base of all errors that `planner` raises on purpose."""

    exit_code = 1


class UsageError(PlannerError):
    """A command-line value cannot be used, such as a `--world` that names no factory."""

    exit_code = 2
    units_missing = False  # whether it is that nobody says what one unit of a drawing is


class JobError(PlannerError):
    """The job file cannot be used as it stands: file, section ("": the top level), key and problem."""

    def __init__(self, problem: str, *, where: str = "", section: str = "", key: str = "") -> None:
        # All but `problem` have defaults, so that the error survives pickling between worker processes.
        place = f"[{section}] {key}".strip() if section else key
        super().__init__(": ".join(part for part in (where, place, problem) if part))
        self.problem, self.where, self.section, self.key = problem, where, section, key

    def at(self, where: str = "", section: str = "", key: str = "") -> Self:
        """The same error with its place added; what it has already stays."""
        place = {
            "where": self.where or where,
            "section": self.section or section,
            "key": self.key or key,
        }
        return type(self)(self.problem, **place)


class InputFileError(JobError):
    """The file is not there, may not be read, is a directory, or is not UTF-8 text."""

    exit_code = 3


class TomlError(JobError):
    """The text is not valid TOML: a bracket missing, a key written twice."""

    exit_code = 4


class KeyNameError(JobError):
    """A key or section is not known here, or one that must be stated is missing."""

    exit_code = 5


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
    """The search ended without a tree that reaches the goal; `success` is the best rate found, 0 to 1.

    `cut_short` tells that it was not done: a longer one may find a plan.
    """

    exit_code = 9
    success = 0.0
    cut_short = False


class ClusterError(PlannerError):
    """The Dask cluster of `--scheduler` does not answer, has no workers or was lost half-way."""

    exit_code = 32
