"""A real process that is killed, or its journal moved, against a cell that outlives it; and the next one."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from running_cells import ROOT, WAIT_S, RunningCell, runtime_command
from sample_tables import small_table
from waiting import until

from runtime.journal.chain import records, verify
from runtime.journal.files import broken_of
from runtime.journal.replay import Replay
from runtime.table import dump


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    dump(small_table(), tmp_path / "small.msgpack")
    return tmp_path / "small.msgpack"


def start(tree: Path, cell: RunningCell, *arguments: str) -> "subprocess.Popen[str]":
    command = runtime_command(tree, cell, tree.with_name("journal.jsonl"), *arguments)
    return subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def path_of(journal: Path) -> tuple[list[int], str]:
    *_, outcome = (entry for entry in records(journal) if entry["kind"] == "outcome")
    return outcome["path"], outcome["outcome"]


def wait_for(journal: Path, kind: str, number: int) -> None:
    text = f'"kind":"{kind}"'.encode()
    until(lambda: journal.exists() and journal.read_bytes().count(text) >= number, kind)


def test_a_killed_process_is_taken_over_by_the_next_one(tree: Path) -> None:
    journal = tree.with_name("journal.jsonl")
    with RunningCell(tree) as cell:
        out, err = start(tree, cell).communicate(timeout=WAIT_S)
        whole = path_of(journal)
        assert len(whole[0]) == 2, (out, err)
    journal.unlink()
    with RunningCell(tree) as cell:
        for kind, number, later_s in [
            ("part", 1, 0.3),
            ("placed", 1, 0.15),
            ("squeeze", 1, 0.05),
            ("placed", 2, 0.0),
        ]:
            process = start(tree, cell, "--after-crash", "resume")
            wait_for(journal, kind, number)
            time.sleep(later_s)
            os.kill(process.pid, signal.SIGKILL)
            process.communicate(timeout=WAIT_S)
        out, err = start(tree, cell, "--after-crash", "resume").communicate(timeout=WAIT_S)
    assert path_of(journal) == whole, (out, err)
    assert "going on with it" in out
    assert verify(journal).closed
    assert list(Replay().follow(records(journal))) == []


def test_without_a_policy_the_next_one_gives_up_and_the_one_after_begins_anew(tree: Path) -> None:
    journal = tree.with_name("journal.jsonl")
    with RunningCell(tree) as cell:
        process = start(tree, cell)
        wait_for(journal, "placed", 1)
        os.kill(process.pid, signal.SIGKILL)
        process.communicate(timeout=WAIT_S)
        given_up = start(tree, cell)
        _, err = given_up.communicate(timeout=WAIT_S)
        assert given_up.returncode == 24
        assert "given up and nothing was moved" in err
        anew = start(tree, cell, "--jaws-empty")
        _, err = anew.communicate(timeout=WAIT_S)
        assert anew.returncode in (0, 10), err
    assert verify(journal).runs == 2
    assert list(Replay().follow(records(journal))) == []


@pytest.mark.parametrize("policy", ["resume", "restart"])
def test_the_part_a_run_broke_off_at_ends_though_count_is_smaller(tree: Path, policy: str) -> None:
    journal = tree.with_name("journal.jsonl")
    with RunningCell(tree, time_scale=40) as cell:
        process = start(tree, cell, "--count", "5")
        wait_for(journal, "part", 3)
        os.kill(process.pid, signal.SIGKILL)
        process.communicate(timeout=WAIT_S)
        broken = next(
            entry["part"] for entry in reversed(list(records(journal))) if "part" in entry
        )
        resumed = start(tree, cell, "--after-crash", policy, "--count", "2")
        out, err = resumed.communicate(timeout=WAIT_S)
    assert broken >= 3
    ended = [entry["part"] for entry in records(journal) if entry["kind"] == "outcome"]
    assert ended == list(range(1, broken + 1)), (out, err)
    assert resumed.returncode in (0, 10)


def removed(path: Path) -> None:
    path.unlink()


def copied_and_truncated(path: Path) -> None:
    shutil.copy(path, path.with_name("journal.jsonl.old"))
    os.truncate(path, 0)


@pytest.mark.parametrize("displace", [removed, copied_and_truncated])
def test_a_run_whose_journal_is_displaced_stops_safely_and_the_next_one_is_refused(
    tree: Path, displace: Callable[[Path], None]
) -> None:
    journal = tree.with_name("journal.jsonl")
    with RunningCell(tree, time_scale=40) as cell:
        process = start(tree, cell, "--count", "1000")
        wait_for(journal, "outcome", 1)
        process.send_signal(signal.SIGSTOP)  # no record comes between the copy and the cut
        os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
        displace(journal)
        process.send_signal(signal.SIGCONT)
        out, err = process.communicate(timeout=WAIT_S)
        assert process.returncode == 24, (out, err)
        assert "while it was written" in out
        following = start(tree, cell, "--jaws-empty")
        _, err = following.communicate(timeout=WAIT_S)
        assert following.returncode == 24
        assert f"beneath a run, whose records are in {broken_of(journal)}" in err
    kept = broken_of(journal).read_bytes()
    old = journal.with_name("journal.jsonl.old")
    journal.write_bytes((old.read_bytes() if old.exists() else b"") + kept)
    broken_of(journal).unlink()
    assert verify(journal).closed
    assert list(Replay().follow(records(journal))) == []
    *_, outcome, end = records(journal)
    assert (outcome["kind"], outcome["exit_code"], end["kind"], end["exit_code"]) == (
        "outcome",
        24,
        "end",
        24,
    )
    assert any("retreat height" in sentence for sentence in outcome["safe_state"])


def test_two_processes_do_not_share_a_gripper(tree: Path) -> None:
    with RunningCell(tree) as cell:
        one = start(tree, cell, "--count", "1000")
        wait_for(tree.with_name("journal.jsonl"), "part", 1)
        other = start(tree, cell, "--journal", str(tree.with_name("other.jsonl")))
        _, err = other.communicate(timeout=WAIT_S)
        one.send_signal(signal.SIGTERM)
        one.communicate(timeout=WAIT_S)
    assert (other.returncode, one.returncode) == (21, 40)
    assert f"process {one.pid}" in err
