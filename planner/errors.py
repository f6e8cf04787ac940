"""Errors of planning, beside those of `runtime.shell.errors`."""

from runtime.shell.errors import ExpectedError, InputError, UsageError
from runtime.shell.exit_codes import ExitCode


class UnitsMissingError(UsageError):
    """Neither the drawing nor the command line says what one unit of the drawing is."""


class KeyNameError(InputError):
    """A key, section or column is not known here, or one that must be stated is missing."""


class FitError(InputError):
    """The part is wider, even across its narrowest side, than the jaws open."""


class NoPlanError(ExpectedError):
    """The search ended without a tree that reaches the goal; `success` is the best rate found, 0 to 1.

    `cut_short` tells that it was not done: a longer one may find a plan.
    """

    exit_code = ExitCode.NO_PLAN
    success = 0.0
    cut_short = False
