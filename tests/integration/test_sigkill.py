"""Processes of runs are killed, or their journal is truncated; the cell goes on, and other runs follow."""

import os
import shutil
import signal
import subprocess
from pathlib import Path

from programs import WAIT_S, Ended, called, started, until
from running_cells import RunningCell, runtime_command
from written_journals import assert_sound

from runtime.cli import main
from runtime.journal.chain import records
from runtime.journal.files import broken_of


def start(tree: Path, cell: RunningCell, *arguments: str) -> "subprocess.Popen[str]":
    return started(runtime_command(tree, cell, tree.with_name("journal.jsonl"), *arguments))


def killed(tree: Path, cell: RunningCell, kind: str, number: int, *arguments: str) -> None:
    """Starts a run and kills it once its journal holds a number of records of a kind."""
    process = start(tree, cell, *arguments)
    wait_for(tree.with_name("journal.jsonl"), kind, number)
    process.kill()
    process.communicate(timeout=WAIT_S)


def run(tree: Path, cell: RunningCell, *arguments: str) -> Ended:
    """Runs grasp-runtime to its end, in this process."""
    journal = tree.with_name("journal.jsonl")
    return called(main, *runtime_command(tree, cell, journal, *arguments)[3:])


def path_of(journal: Path) -> tuple[list[int], str]:
    *_, outcome = (entry for entry in records(journal) if entry["kind"] == "outcome")
    return outcome["path"], outcome["outcome"]


def wait_for(journal: Path, kind: str, number: int) -> None:
    text = f'"kind":"{kind}"'.encode()
    until(lambda: journal.exists() and journal.read_bytes().count(text) >= number, kind)


def test_grasp_runtime_killed_three_times_resumes_to_same_path(tree: Path) -> None:
    journal = tree.with_name("journal.jsonl")
    with RunningCell(tree, time_scale=20) as cell:
        _, out, err = run(tree, cell)
        whole = path_of(journal)
        assert len(whole[0]) == 2, (out, err)
    journal.unlink()
    with RunningCell(tree, time_scale=20) as cell:
        for kind, number in (("placed", 1), ("squeeze", 1), ("placed", 2)):
            killed(tree, cell, kind, number, "--after-crash", "resume")
        _, out, err = run(tree, cell, "--after-crash", "resume")
    assert path_of(journal) == whole, (out, err)
    assert "going on with it" in out
    assert_sound(journal)


def test_grasp_runtime_restart_ends_interrupted_part_beyond_count(tree: Path) -> None:
    journal = tree.with_name("journal.jsonl")
    with RunningCell(tree, time_scale=40) as cell:
        killed(tree, cell, "part", 3, "--count", "5")
        *_, broken = (entry["part"] for entry in records(journal) if "part" in entry)
        code, out, err = run(tree, cell, "--after-crash", "restart", "--count", "2")
    assert broken >= 3
    ended = [entry["part"] for entry in records(journal) if entry["kind"] == "outcome"]
    assert ended == list(range(1, broken + 1)), (out, err)
    assert code in (0, 10)


def test_grasp_runtime_truncated_journal_stops_run_and_refuses_next(tree):
    """The journal is copied and truncated, as `logrotate` does; unit tests replace it in other ways."""
    journal, old = (tree.with_name(name) for name in ("journal.jsonl", "journal.jsonl.old"))
    with RunningCell(tree, time_scale=40) as cell:
        process = start(tree, cell, "--count", "1000")
        wait_for(journal, "outcome", 1)
        process.send_signal(signal.SIGSTOP)  # no record comes between the copy and the cut
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
        shutil.copy(journal, old)
        os.truncate(journal, 0)
        process.send_signal(signal.SIGCONT)
        out, err = process.communicate(timeout=WAIT_S)
        assert process.returncode == 24, (out, err)
        assert "while it was written" in out
        code, _, err = run(tree, cell, "--jaws-empty")
        assert code == 24
        assert f"beneath a run, whose records are in {broken_of(journal)}" in err
    kept = broken_of(journal).read_bytes()
    journal.write_bytes(old.read_bytes() + kept)
    broken_of(journal).unlink()
    assert_sound(journal)
    *_, outcome, end = records(journal)
    ends = [(each["kind"], each["exit_code"]) for each in (outcome, end)]
    assert ends == [("outcome", 24), ("end", 24)]
    assert any("retreat height" in sentence for sentence in outcome["safe_state"])


def test_grasp_runtime_second_process_on_gripper_is_refused(tree: Path) -> None:
    with RunningCell(tree, time_scale=20) as cell:
        one = start(tree, cell, "--count", "1000")
        wait_for(tree.with_name("journal.jsonl"), "part", 1)
        code, _, err = run(tree, cell, "--journal", str(tree.with_name("other.jsonl")))
        one.send_signal(signal.SIGTERM)
        one.communicate(timeout=WAIT_S)
    assert (code, one.returncode) == (21, 40)
    assert f"process {one.pid}" in err
