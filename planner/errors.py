"""Errors of planning; `runtime.shell.errors` has the general ones."""

from runtime.shell.errors import ExpectedError, InputError, UsageError
from runtime.shell.exit_codes import ExitCode


class UnitsMissingError(UsageError):
    """Neither the drawing nor the command line states the unit of the drawing."""


class KeyNameError(InputError):
    """A key, section or column is unknown, or a required one is missing."""


class FitError(InputError):
    """The part is wider than the jaws open, even across its narrowest side."""


class NoPlanError(ExpectedError):
    """The search ended without a tree that reaches the goal.

    `success` is the share of the parts that the best tree locates, 0 to 1. `cut_short` states that the search
    was not finished, so that a longer one may find a plan.
    """

    exit_code = ExitCode.NO_PLAN
    success = 0.0
    cut_short = False
