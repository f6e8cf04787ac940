"""A simulated cell that cannot be started is reported in one sentence and leaves no process behind."""

import subprocess
import sys
from pathlib import Path

import pytest
from programs import TABLE

from runtime.devices import cell_process, child
from runtime.devices.cell_process import CellProcess
from runtime.shell.errors import UnreachableError


def refusal_of(monkeypatch: pytest.MonkeyPatch, executable: str) -> str:
    """The message of the refusal when `executable` runs in place of Python."""
    started: list[subprocess.Popen[bytes]] = []

    class Noted(subprocess.Popen):
        def __init__(self, *words, **settings) -> None:
            super().__init__(*words, **settings)
            started.append(self)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    monkeypatch.setattr(sys, "executable", executable)
    with pytest.raises(UnreachableError) as refused:
        CellProcess(TABLE, world="runtime.devices.rehearsal:make", seed=1, time_scale=10.0)
    assert all(process.poll() is not None for process in started)
    return str(refused.value)


def script(folder: Path, text: str) -> str:
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("exit 7", "ended with exit code 7 before it served"),
        *((f"echo '{answer}'; exec cat", "instead of its endpoints") for answer in ("hello", "[]")),
        ("""echo '{"gripper": "/dev/pts/9"}'; exec cat""", "instead of its endpoints"),
    ],
)
def test_cell_process_that_ends_or_answers_wrongly_is_reported(monkeypatch, tmp_path, text, said):
    assert said in refusal_of(monkeypatch, script(tmp_path, text))


def test_cell_process_of_missing_program_is_reported(monkeypatch, tmp_path):
    message = refusal_of(monkeypatch, str(tmp_path / "python"))
    assert message.startswith("grasp-cell cannot be started: No such file or directory")


def test_cell_process_that_stays_silent_is_ended_and_reported(monkeypatch, tmp_path):
    monkeypatch.setattr(cell_process, "START_S", 0.05)
    monkeypatch.setattr(child, "END_S", 0.05)
    result = refusal_of(
        monkeypatch, script(tmp_path, "trap '' TERM; while true; do sleep 0.05; done")
    )
    assert "printed no endpoints within 0.05 s" in result
