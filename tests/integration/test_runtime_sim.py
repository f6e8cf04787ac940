"""grasp-runtime against a real grasp-cell process: real frames on a pty, the arm's protocol over TCP."""

import base64
import json
import os
import signal
import subprocess
from pathlib import Path

from programs import REHEARSAL, RUNTIME, WAIT_S, Ended, called, started, until
from sample_tables import small_table

from runtime.cli import main
from runtime.journal.chain import records, verify
from runtime.table import REJECT, decision_map, dumps, loads


def words(tree: Path, *more: str) -> list[object]:
    journal = tree.with_name("journal.jsonl")
    return ["--tree", tree, "--port", "sim", *REHEARSAL, "--journal", journal, *more]


def start(tree: Path, *more: str) -> subprocess.Popen[str]:
    return started([*RUNTIME, *words(tree, *more)])


def finish(process: subprocess.Popen[str]) -> Ended:
    out, err = process.communicate(timeout=WAIT_S)
    return Ended(process.returncode, out, err)


def squeezing(tree: Path, scale: str) -> subprocess.Popen[str]:
    """Starts a run at a time scale and waits until it has squeezed a part."""
    process = start(tree, "--count", "1000", "--time-scale", scale)
    assert process.stdout is not None
    while "squeeze 1" not in process.stdout.readline():
        assert process.poll() is None
    return process


def cells(tree: Path) -> list[int]:
    """Processes of cells that were started for this tree."""
    results = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = entry.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"drivers.sim.cli" in words and str(tree).encode() in words:
            results.append(int(entry.parent.name))
    return results


def wait_until_no_cell(tree: Path) -> None:
    until(lambda: not cells(tree), "cell processes are left behind")


def test_grasp_runtime_decisions_follow_table_and_are_journalled(tree: Path) -> None:
    """The run takes real time; a second run, in virtual time, has the same parts from the same seed."""
    more = ("--count", "6", "--seed", "3", "--time-scale")
    code, out, err = finish(start(tree, *more, "60", "--json"))
    parts = [json.loads(line) for line in out.splitlines()]
    assert len(parts) == 6, err
    assert code == max(part["exit_code"] for part in parts)
    assert {part["outcome"] for part in parts} <= {"leaf", "unresolved", "reject"}
    assert sum(part["outcome"] == "reject" for part in parts) <= 2
    assert all(part["crashes"] == 0 for part in parts)
    journal = tree.with_name("journal.jsonl")
    seen = verify(journal)
    assert seen.closed
    data = base64.b64decode(next(records(journal))["table_base64"])
    assert data == dumps(small_table())
    table = loads(data)
    maps = [decision_map(node, table.gripper).felt for node in table.nodes]
    squeezes = [entry for entry in records(journal) if entry["kind"] == "squeeze"]
    for entry in squeezes:
        branch = maps[entry["node"]].at(entry["width_um"]) if entry["object_flag"] == 2 else REJECT
        expected = None if branch == REJECT else table.nodes[entry["node"]].branches[branch].target
        assert entry["target"] == expected
        assert entry["target_um"] == -1
    passed = [node for part in parts for node in part["path"]]
    assert [entry["node"] for entry in squeezes] == passed
    wait_until_no_cell(tree)
    virtual = words(tree, *more, "max")
    document, printed = (called(main, *virtual, *form) for form in (["--json"], []))
    assert (document.code, printed.code) == (code, code)
    again = [json.loads(line)["path"] for line in document.out.splitlines()]
    assert again == [part["path"] for part in parts]
    printed = printed.out
    assert "simulated cell (runtime.devices.rehearsal:make)" in printed
    assert "activating the gripper" in printed
    last = printed.splitlines()[-1]
    assert last.startswith("6 parts: ")
    assert str(journal) in last


def test_grasp_runtime_killed_leaves_no_cell_and_open_journal(tree: Path) -> None:
    process = squeezing(tree, "30")
    assert len(cells(tree)) == 1
    process.kill()
    finish(process)
    wait_until_no_cell(tree)
    assert not verify(tree.with_name("journal.jsonl")).closed


def test_grasp_runtime_killed_cell_is_fault_with_its_code(tree: Path) -> None:
    process = squeezing(tree, "20")
    (cell,) = cells(tree)
    os.kill(cell, signal.SIGKILL)
    code, out, err = finish(process)
    assert code in (20, 21), err
    assert "FAULT" in out or "scene" in err
    assert verify(tree.with_name("journal.jsonl")).closed
