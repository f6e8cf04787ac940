"""The fuzzers of `tools/hostile`: each passes a short run, and reports planted errors."""

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


def test_fuzz_tables_mutated_table_is_refused_or_legal():
    tally = fuzz_tables.run(1, range(1_000))
    assert tally.failures == []
    assert sum(tally.verdicts.values()) == 1_000
    for depth in ("file", "payload", "values"):
        assert tally.verdicts[f"{depth}: refused"] > 120
    # Some mutants are refused only by the validation, others pass it.
    assert tally.verdicts["values: another table"] > 20
    assert tally.verdicts["file: another table"] == 0


def test_fuzz_tables_reader_that_accepts_everything_is_reported(monkeypatch):
    accepted = fuzz_tables.loads(fuzz_tables.seeds()[0])
    monkeypatch.setattr(fuzz_tables, "loads", lambda data: accepted)
    tally = fuzz_tables.run(1, range(20))
    assert tally.failures
    assert tally.failures[0].startswith("--seed 1 --first ")


def test_fuzz_tables_reader_that_hangs_is_reported(monkeypatch):
    def hang(data):
        while True:
            pass

    monkeypatch.setattr(fuzz_tables, "LONGEST_S", 0.05)
    monkeypatch.setattr(fuzz_tables, "loads", hang)
    (failure,) = fuzz_tables.run(1, range(1)).failures
    assert "TimeoutError" in failure


def test_fuzz_frames_master_that_accepts_noise_raises(monkeypatch):
    monkeypatch.setattr(fuzz_frames.ModbusLink, "read", lambda link: bytes(6))
    with pytest.raises(AssertionError, match="no sound frame"):
        fuzz_frames.case(fuzz_frames.CORPUS[3])


def test_hostile_frames_without_atheris_finds_no_failure(tmp_path):
    (tmp_path / "atheris.py").write_text("raise ModuleNotFoundError('No module named atheris')\n")
    done = run_tool("frames", "--seconds", "1", PYTHONPATH=str(tmp_path))
    assert done.returncode == 0, done.stdout
    assert "frames: 0 failures" in done.stdout


def test_hostile_inputs_almost_valid_files_end_without_failure():
    failures: list[str] = []
    ends = hostile_inputs.run(7, range(1, 45), failures.append)
    assert failures == []
    assert len({end.partition(":")[0] for end in ends}) >= 8  # commands


@pytest.mark.parametrize(
    ("code", "err"),
    [(1, "{name}: internal error\n"), (2, ""), (0, "Traceback")],
    ids=["internal error", "no message", "traceback"],
)
def test_hostile_inputs_undocumented_end_raises(code, err, monkeypatch):
    given = hostile_inputs.case(7, 1)
    err = err.format(name=hostile_inputs.err_name(given.entry))
    monkeypatch.setattr(hostile_inputs, "_within", lambda _: hostile_inputs.Ended(code, "", err))
    with pytest.raises(AssertionError):
        hostile_inputs.judge(given)


def test_hostile_inputs_case_that_hangs_is_reported(monkeypatch):
    monkeypatch.setattr(hostile_inputs, "judge", lambda given, as_process: time.sleep(60))
    lines: list[str] = []
    assert hostile_inputs.run(7, range(1, 3), lines.append, longest_s=0.1)["FAILED"] == 2
    assert "no end within" in lines[0]
