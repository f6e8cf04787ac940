"""The exit codes are few, and OUTCOMES.md and the error classes have the same."""

import importlib

from documents import rows, section
from programs import ROOT

from runtime.shell.errors import ExpectedError
from runtime.shell.exit_codes import ExitCode

MODULES = ("runtime.shell.errors", "planner.errors", "runtime.errors", "drivers.errors")
RETURNED = {ExitCode.DONE, ExitCode.NOT_LOCATED, ExitCode.UNDECIDED, ExitCode.INTERRUPTED}
"""Codes that a command returns, and no error carries."""


def classes() -> list[type[ExpectedError]]:
    """All error classes of the project."""
    named = [item for name in MODULES for item in vars(importlib.import_module(name)).values()]
    return [item for item in named if isinstance(item, type) and issubclass(item, ExpectedError)]


def test_exit_codes_are_at_most_twelve_beside_success_and_interrupt():
    assert len(set(ExitCode) - {ExitCode.DONE, ExitCode.INTERRUPTED}) <= 12
    assert all(code < 126 for code in set(ExitCode) - {ExitCode.INTERRUPTED})


def test_outcomes_list_each_code_with_its_sentence():
    text = (ROOT / "runtime" / "OUTCOMES.md").read_text(encoding="utf-8")
    listed = [row[:2] for row in rows(section(text, "Exit codes"))]
    assert listed == [[str(code.value), code.sentence] for code in ExitCode]


def test_error_classes_carry_every_code_that_no_command_returns():
    assert {cls.exit_code for cls in classes()} == set(ExitCode) - RETURNED
