"""Each way to stop a command that moves something, and the state in which its gripper ends."""

import contextlib
import fcntl
import os
import pty
import termios
from collections.abc import Iterator
from pathlib import Path
from signal import SIGHUP, SIGINT, SIGQUIT, SIGTERM

import pytest
from hostile_signals import Bench, Case, Ended, campaign
from programs import WAIT_S, ended, started
from running_cells import Notices, calibrate_command, runtime_command

from runtime.journal.chain import records, verify

CASES = {
    "Ctrl-C in a calibration's stroke": Case("calibration", (SIGINT,), 0.7, 0.0, 0.0),
    "SIGTERM in its activation": Case("calibration's activation", (SIGTERM,), 0.3, 0.0, 0.0),
    "SIGHUP in a run's activation": Case("activation", (SIGHUP,), 0.3, 0.0, 0.0),
    "SIGHUP in a simulated run": Case("simulated run", (SIGHUP,), 0.5, 0.0, 0.0),
    "Ctrl-C twice within 30 ms": Case("run", (SIGINT, SIGINT), 0.4, 0.03, 0.0),
    "Ctrl-C, then SIGTERM on the way out": Case("run", (SIGINT, SIGTERM), 0.4, 0.1, 0.0),
    "stopped past every deadline of a run": Case("run", (SIGQUIT,), 0.4, 0.0, 2.0),
    "SIGTERM and SIGHUP in a fault": Case("fault", (SIGTERM, SIGHUP), 0.01, 0.03, 0.0),
}


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with contextlib.closing(Bench(tmp_path_factory.mktemp("sound"), faulty=False)) as bench:
        yield bench


@pytest.fixture(scope="module")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with contextlib.closing(Bench(tmp_path_factory.mktemp("faulty"), faulty=True)) as bench:
        yield bench


@pytest.mark.parametrize("name", CASES)
def test_stop_request_ends_command_safely(name: str, sound: Bench, faulty: Bench) -> None:
    bench = faulty if CASES[name].kind == "fault" else sound
    assert bench.run(CASES[name])[1] == []


def test_grasp_runtime_lost_terminal_stops_safely(sound: Bench, tmp_path: Path) -> None:
    """As at the loss of an SSH session: SIGHUP arrives, and later reads and writes fail."""
    sound.prepare(active=True)
    journal = tmp_path / "journal.jsonl"
    ours, theirs = pty.openpty()
    with contextlib.closing(Notices(tmp_path)) as notices:
        process = started(
            runtime_command(sound.tree, sound.cell, journal, "--count", "1000"),
            env=notices.environment,
            **dict.fromkeys(("stdin", "stdout", "stderr"), theirs),
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        os.close(theirs)
        assert notices.wait(": squeeze", process)
        os.close(ours)
        code = process.wait(WAIT_S)
    *_, outcome, end = records(journal)
    assert (code, outcome["outcome"], end["exit_code"]) == (40, "stopped", 40)
    assert verify(journal).closed
    said = " ".join(map(str, outcome["safe_state"]))
    assert list(sound._moving(Ended(code, said, "", journal))) == []
    assert list(sound._low(Ended(code, "", "", journal))) == []


def test_calibrate_end_of_stdin_stops_fingers_and_writes_nothing(
    sound: Bench, tmp_path: Path
) -> None:
    """The input ends between two gauge blocks, while the fingers are at rest."""
    sound.prepare(active=True)
    output = tmp_path / "gripper.json"
    words = calibrate_command(sound.cell, output, "--blocks", "0,20,40", "--grips", "1")
    code, out, err = ended(words, input="\n")
    assert (code, output.exists()) == (2, False)
    assert "standard input ended before Enter was pressed" in err
    assert "fingers stopped at" in err
    assert list(sound._moving(Ended(code, out, err, output))) == []


def test_campaign_of_two_cases_has_no_failures() -> None:
    """This is a short campaign; `tools/hostile signals` runs as many cases as are asked for."""
    assert campaign(2, 16) == 0
