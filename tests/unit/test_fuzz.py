"""The fuzzers themselves: a slice of what `tools/hostile` runs, repeatable, able to find what is wrong."""

import os
import subprocess
import sys
import time
from pathlib import Path

import fuzz_frames
import fuzz_tables
import hostile_inputs
import pytest

pytestmark = pytest.mark.slow

TOOL = Path(__file__).parents[2] / "tools" / "hostile"


def run_tool(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(TOOL), *arguments]
    environment = {**os.environ, **variables}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def test_a_slice_of_the_mutated_tables_is_refused_or_another_legal_table():
    tally = fuzz_tables.run(1, range(1_000))
    assert tally.failures == []
    assert sum(tally.verdicts.values()) == 1_000
    for depth in ("file", "payload", "values"):
        assert tally.verdicts[f"{depth}: refused"] > 120
    # The mutants get as far as the validation, and past it.
    assert tally.verdicts["values: another table"] > 20
    assert tally.verdicts["file: another table"] == 0


def test_a_reader_that_accepts_too_much_is_found(monkeypatch):
    accepted = fuzz_tables.loads(fuzz_tables.seeds()[0])
    monkeypatch.setattr(fuzz_tables, "loads", lambda data: accepted)
    tally = fuzz_tables.run(1, range(20))
    assert tally.failures
    assert tally.failures[0].startswith("--seed 1 --first ")


def test_a_reader_that_crashes_or_hangs_is_found(monkeypatch):
    def hang(data):
        while True:
            pass

    monkeypatch.setattr(fuzz_tables, "LONGEST_S", 0.05)
    monkeypatch.setattr(fuzz_tables, "loads", hang)
    (failure,) = fuzz_tables.run(1, range(1)).failures
    assert "TimeoutError" in failure


def test_a_master_that_believes_noise_is_found(monkeypatch):
    monkeypatch.setattr(fuzz_frames.ModbusLink, "read", lambda link: bytes(6))
    with pytest.raises(AssertionError, match="no sound frame"):
        fuzz_frames.case(fuzz_frames.CORPUS[3])


def test_the_tool_fuzzes_frames_without_its_engine(tmp_path):
    (tmp_path / "atheris.py").write_text("raise ModuleNotFoundError('No module named atheris')\n")
    done = run_tool("frames", "--seconds", "1", PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stdout
    assert "frames: 0 failures" in done.stdout


def test_a_slice_of_the_files_that_are_almost_right_ends_as_commands_must():
    failures: list[str] = []
    ends = hostile_inputs.run(7, range(1, 45), failures.append)
    assert failures == []
    assert len({end.partition(":")[0] for end in ends}) >= 8  # commands


def test_a_command_that_hangs_or_ends_otherwise_is_found(monkeypatch):
    def end(code, err=""):
        seen = hostile_inputs.Ended(code, "", err)
        monkeypatch.setattr(hostile_inputs, "_within", lambda result: seen)

    result = hostile_inputs.case(7, 1)
    for code, err in (
        (1, f"{hostile_inputs.err_name(result.entry)}: internal error\n"),
        (2, ""),
        (0, "Traceback"),
    ):
        end(code, err)
        with pytest.raises(AssertionError):
            hostile_inputs.judge(result)
    monkeypatch.setattr(hostile_inputs, "judge", lambda result, as_process: time.sleep(60))
    lines: list[str] = []
    assert hostile_inputs.run(7, range(1, 3), lines.append, longest_s=0.1)["FAILED"] == 2
    assert "no end within" in lines[0]
