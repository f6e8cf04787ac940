"""A run of many parts: its output, what ends it, and its exit code; without a process or a port."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from fake_cell import FakeCell, FakeScene, Log, State, fake_cell
from sample_tables import small_table
from squeezes import AT_21, AT_30, AT_36

from runtime.cli import main
from runtime.errors import GripperStateError
from runtime.execution import session
from runtime.execution.events import Console, Tally
from runtime.execution.executor import RunOptions
from runtime.monitoring.console import Lines, Objects

JOURNAL = Path("j.jsonl")
TRUTH = SimpleNamespace(x_mm=0.3, y_mm=0.9, theta_rad=3.14159265, squeezes=1, crashes=0)
TRUTH.hypothesis = 0


def run(rig: FakeCell, truth: object, console: Console, count: int = 1, *, activate=False) -> Tally:
    scene = None if truth is None else FakeScene(truth)
    cell, options = replace(rig.cell, scene=scene), RunOptions(activate=activate, count=count)
    return session.run_journalled(small_table(), cell, console, options)


def test_run_journalled_rejects_continue_and_gravest_code_wins():
    rig = fake_cell([AT_21, AT_36, AT_30, AT_36, AT_21])
    tally = run(rig, None, Lines(small_table()), 4)
    outcomes = {"leaf": 2, "reject": 1, "unresolved": 1}
    end = {"parts": 4, "outcomes": outcomes, "exit_code": 10, "reason": None}
    assert rig.journal.kept[-1] == ("end", end)
    assert (tally.exit_code, tally.squeezes, tally.within, tally.crashes) == (10, 5, None, None)


def test_run_journalled_fault_ends_run():
    rig = fake_cell([AT_21, AT_21], Log(40, ConnectionError("cable")))
    tally = run(rig, None, Lines(small_table()), 5)
    assert tally.fields()["outcomes"] == {"leaf": 1, "fault": 1}
    assert tally.exit_code == 21
    assert rig.journal.kinds()[-1] == "end"


@pytest.mark.parametrize(
    ("state", "said"),
    [(State(activated=False), "not activated"), (State(fault=0x0E), r"0x0E.*with --activate")],
)
def test_run_journalled_unready_gripper_needs_activate(state, said):
    rig = fake_cell([AT_21])
    rig.gripper.now = state
    with pytest.raises(GripperStateError, match=said):
        run(rig, None, Lines(small_table()))
    assert rig.log.named("activate") == []
    assert rig.journal.kept[-1][1]["exit_code"] == 20
    run(rig, None, Lines(small_table()), activate=True)
    assert len(rig.log.named("activate")) == 1


def test_run_journalled_ctrl_c_at_first_call_is_recorded():
    rig = fake_cell([AT_21], Log(0, KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        run(rig, None, Lines(small_table()))
    assert rig.journal.kept[-1][1]["exit_code"] == 40


def test_objects_print_one_complete_line_per_part(capsys):
    rig, table = fake_cell([AT_21, AT_36]), small_table()
    run(rig, TRUTH, Objects(table, JOURNAL), 2)
    leaf, reject = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert leaf["outcome"] == "leaf"
    assert (leaf["leaf"], leaf["path"], leaf["widths_mm"]) == (0, [0], [20.969])
    assert leaf["predicted_pose"] == {"x_mm": 0.0, "y_mm": 0.5, "theta_rad": 0.0}
    assert (leaf["error_mm"], leaf["within_goal"], leaf["audit"]) == (0.5, True, None)
    assert (reject["outcome"], reject["leaf"], reject["predicted_pose"]) == ("reject", None, None)
    assert reject["within_goal"] is None
    assert leaf.keys() == reject.keys()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("--port /dev/ttyNONE --arm tcp://127.0.0.1:9", 21, "/dev/ttyNONE"),
        ("--port tcp://127.0.0.1:1 --arm tcp://127.0.0.1:9", 21, "127.0.0.1:1"),
        ("--port sim --arm tcp://127.0.0.1:9", 2, "brings its own arm"),
        ("--port /dev/ttyUSB0", 2, "name it with --arm"),
        ("", 2, "name the gripper with --port"),
        ("--port sim --check", 2, "looks at an attached gripper"),
        ("--port sim --on-reject again", 2, "name resqueeze, restart, next, stop"),
        ("--port sim --tips bent", 2, "LINK,OFFSET"),
        ("--port sim --deliver 1,2", 2, "x,y,angle"),
        ("--port sim --deliver nowhere.toml", 3, "nowhere.toml"),
        ("--port tcp://h:1 --arm tcp://h:1", 2, "both name"),
        ("--port sim --calibration nowhere.json", 3, "nowhere.json"),
        ("--port /dev/ttyUSB0 --arm tcp://h:1 --time-scale 2", 2, "for --port sim"),
        ("--port sim --world runtime.devices.rehearsal:make --journal /dev/full", 24, "no regular"),
    ],
)
def test_grasp_runtime_wrong_arguments_exit_with_code_and_message(
    tree, monkeypatch, capfd, arguments, code, message
):
    monkeypatch.chdir(tree.parent)
    assert main(["--tree", str(tree), *arguments.split()]) == code
    last = capfd.readouterr().err.splitlines()[-1]
    assert last.startswith("grasp-runtime: ")
    assert message in last
    assert not Path("squeezetree-journal.jsonl").exists()
