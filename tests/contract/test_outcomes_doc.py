"""OUTCOMES.md, the error classes and the systemd unit agree with the code."""

import importlib
import re
import shlex
from pathlib import Path

import pytest
from documents import rows, section
from programs import ROOT
from soaking import soak_run

from drivers.sim.faults import KINDS
from runtime.commands.arguments import parser
from runtime.execution.events import Phase
from runtime.shell.errors import ExpectedError
from runtime.shell.exit_codes import ExitCode
from runtime.traversal.results import EXIT_CODES, Outcome

TEXT = (ROOT / "runtime" / "OUTCOMES.md").read_text()
UNIT = (ROOT / "tools" / "systemd" / "squeezetree@.service").read_text()


def setting(name: str) -> str:
    """The value of a setting in the systemd unit."""
    (value,) = re.findall(rf"^{name}=(.*)$", UNIT, re.MULTILINE)
    return str(value)


def test_outcomes_page_states_are_phases_of_loop():
    states = [row[0].strip("`") for row in rows(section(TEXT, "States"))]
    assert states == [phase.value for phase in Phase]


def test_outcomes_page_lists_each_outcome_with_its_code():
    record = {row[0].strip("`"): row[1] for row in rows(section(TEXT, "Outcomes"))}
    assert record == {each.value: str(EXIT_CODES.get(each, "the device's")) for each in Outcome}


def test_outcomes_page_faults_are_codes_of_devices_and_journal():
    codes = {int(row[0]) for row in rows(section(TEXT, "Faults"))}
    assert codes == {ExitCode.DEVICE, ExitCode.UNREACHABLE, ExitCode.JOURNAL}
    assert f"{len(KINDS)} classes" in TEXT


def test_systemd_unit_command_line_is_understood():
    program, name, *words = shlex.split(setting("ExecStart"))
    assert (program, name) == ("/usr/bin/env", "grasp-runtime")
    (example,) = re.findall(r"ARGUMENTS=(--.*)$", UNIT, re.MULTILINE)
    arguments = parser().parse_args([*words[:-1], *shlex.split(example)])
    assert words[-1] == "$ARGUMENTS"
    assert arguments.journal == Path("/var/lib/squeezetree/%i.jsonl")


def test_systemd_unit_takes_ends_of_parts_for_success():
    ends = {code for outcome, code in EXIT_CODES.items() if outcome is not Outcome.ABORTED} - {0}
    assert set(map(int, setting("SuccessExitStatus").split())) == ends
    assert float(setting("WatchdogSec")) == soak_run.WATCHDOG_S
    assert setting("Type") == "notify"
    assert setting("Restart") == "no"


MODULES = ("runtime.shell.errors", "planner.errors", "runtime.errors", "drivers.errors")
RETURNED = {
    *(ExitCode.DONE, ExitCode.NOT_LOCATED, ExitCode.UNDECIDED),
    *(ExitCode.STOPPED, ExitCode.INTERRUPTED),
}
"""Codes that a command returns and that no error has."""


def classes() -> list[type[ExpectedError]]:
    """All error classes of the project."""
    named = [item for name in MODULES for item in vars(importlib.import_module(name)).values()]
    return [item for item in named if isinstance(item, type) and issubclass(item, ExpectedError)]


@pytest.mark.parametrize("cls", classes(), ids=lambda cls: cls.__name__)
def test_error_class_has_exit_code_of_its_cause(cls):
    codes = {"ExpectedError": 1, "UsageError": 2, "InputError": 3, "NoPlanError": 4}
    codes |= {"CheckFailedError": 11, "DeviceError": 20, "UnreachableError": 21, "StoppedError": 40}
    codes |= {"PackError": 34, "JournalError": 24, "BrokenRunError": 24}
    assert cls.exit_code == next(
        codes[each.__name__] for each in cls.mro() if each.__name__ in codes
    )


def test_exit_codes_are_at_most_twelve_beside_success_and_interrupt():
    assert len(set(ExitCode) - {ExitCode.DONE, ExitCode.INTERRUPTED}) <= 12
    assert all(code < 126 for code in set(ExitCode) - {ExitCode.INTERRUPTED})


def test_outcomes_page_lists_each_exit_code_with_its_sentence():
    text = (ROOT / "runtime" / "OUTCOMES.md").read_text(encoding="utf-8")
    listed = [row[:2] for row in rows(section(text, "Exit codes"))]
    assert listed == [[str(code.value), code.sentence] for code in ExitCode]


def test_error_classes_carry_every_code_that_no_command_returns():
    assert {cls.exit_code for cls in classes()} == set(ExitCode) - RETURNED
