"""OUTCOMES.md, FAULTS.md and the systemd unit say what the code does."""

import re
import shlex
from pathlib import Path

from documents import rows, section
from programs import ROOT
from soaking import soak_run

from drivers.sim.faults import KINDS
from runtime.commands.arguments import parser
from runtime.execution.events import Phase
from runtime.shell.exit_codes import ExitCode
from runtime.traversal.results import EXIT_CODES, Outcome

TEXT = (ROOT / "runtime" / "OUTCOMES.md").read_text()
UNIT = (ROOT / "tools" / "systemd" / "squeezetree@.service").read_text()


def setting(name: str) -> str:
    """A setting of the unit."""
    (value,) = re.findall(rf"^{name}=(.*)$", UNIT, re.MULTILINE)
    return str(value)


def test_the_states_are_those_of_the_loop():
    assert [row[0].strip("`") for row in rows(section(TEXT, "States"))] == [
        phase.value for phase in Phase
    ]


def test_the_outcomes_have_their_codes():
    record = {row[0].strip("`"): row[1] for row in rows(section(TEXT, "Outcomes"))}
    assert record == {
        outcome.value: str(EXIT_CODES.get(outcome, "the device's")) for outcome in Outcome
    }


def test_the_faults_are_the_codes_of_devices_and_disk():
    codes = {int(row[0]) for row in rows(section(TEXT, "Faults"))}
    assert codes == {ExitCode.DEVICE, ExitCode.UNREACHABLE, ExitCode.JOURNAL}
    assert f"{len(KINDS)} classes" in TEXT


def test_the_units_command_line_is_understood():
    program, name, *words = shlex.split(setting("ExecStart"))
    assert (program, name) == ("/usr/bin/env", "grasp-runtime")
    (example,) = re.findall(r"ARGUMENTS=(--.*)$", UNIT, re.MULTILINE)
    arguments = parser().parse_args([*words[:-1], *shlex.split(example)])
    assert words[-1] == "$ARGUMENTS"
    assert arguments.journal == Path("/var/lib/squeezetree/%i.jsonl")


def test_the_unit_takes_the_ends_of_parts_for_no_failure_and_waits_long_enough():
    ends = {code for outcome, code in EXIT_CODES.items() if outcome is not Outcome.ABORTED} - {0}
    assert set(map(int, setting("SuccessExitStatus").split())) == ends
    assert float(setting("WatchdogSec")) == soak_run.WATCHDOG_S
    assert setting("Type") == "notify"
    assert setting("Restart") == "no"
