"""Planning as three commands: their order, what ends them, how Stop reaches them, and further trials."""

import json
import sys

import pytest

from planner.studio import steps

OBEDIENT = """
import json, pathlib, signal, sys, time
JOB = "[uncertainty]\\nradius_mm = 1.2\\n[goal]\\ndistance_mm = 1.0"
words = sys.argv[1:]
print("ran", words[0], flush=True)
if words[0] == "try" and "--budget=1" in words:
    pathlib.Path("a.stop").touch()
    try: time.sleep(60)
    except KeyboardInterrupt: print("kept", flush=True)
if words[0] == "try" and "--turn=0" not in words: pathlib.Path("a.msgpack").touch()
if "--radius=1" in words: pathlib.Path("a.toml").write_text(JOB)
if words[0] == "plan":
    folder = pathlib.Path(words[words.index("-o") + 1])
    folder.mkdir(exist_ok=True)
    value = float(words[words.index("--vary") + 1].partition("=")[2])
    located = 1.0 if value < 2 else 0.5  # so that discs of 2 mm fail, and no goal does
    (folder / "summary.json").write_text(json.dumps([{"success_rate": located}]))
sys.exit(5 if "--scale=1" in words else 0)
"""


def printed(lines):
    """The lines that the commands print, without the records of the log."""
    return [line for line in lines if line[:1] != "{"]


@pytest.fixture
def ran(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(steps, "COMMAND", [sys.executable, "-c", OBEDIENT])

    def run(*arguments):
        """Runs the steps; returns their exit code and the lines of the log."""
        code = steps.main(["a", "a.dxf", *arguments])
        return code, capfd.readouterr().out.splitlines()

    return run


def test_main_runs_try_report_and_run_in_turn(ran):
    code, lines = ran()
    assert code == 0
    assert printed(lines) == ["ran try", "ran report", "ran run"]
    assert json.loads(lines[-1]) == {"exit": 0}


@pytest.mark.parametrize(
    ("option", "expected"), [("--scale=1", 5), ("--turn=0", 0)], ids=["failed", "no table"]
)
def test_main_failed_command_or_missing_table_ends_the_run(ran, option, expected):
    code, lines = ran(option)
    assert code == expected
    assert printed(lines) == ["ran try"]
    assert json.loads(lines[-1]) == {"exit": expected}


def test_main_stop_file_interrupts_the_search_and_the_rest_follows(ran, tmp_path):
    code, lines = ran("--budget=1")
    assert code == 0
    assert printed(lines) == ["ran try", "kept", "ran report", "ran run"]
    assert not (tmp_path / "a.stop").exists()


def test_main_tries_other_discs_and_goals_until_one_is_too_much(ran, tmp_path):
    code, lines = ran("--radius=1")
    assert code == 0
    assert json.loads(next(line for line in lines if '"exit"' in line)) == {"exit": 0}
    tried = [json.loads(line) for line in lines if '"tried"' in line]
    discs = [row for row in tried if row["tried"] == "uncertainty.radius_mm"]
    goals = [row for row in tried if row["tried"] == "goal.distance_mm"]
    assert [row["value"] for row in discs] == [1.5, 1.9, 2.4]
    assert [row["enough"] for row in discs] == [True, True, False]
    assert len(goals) == 5
    assert all(row["enough"] for row in goals)
    assert discs[0]["command"].startswith("squeezetree plan a.toml -o a.what-if --vary")
    assert not [line for line in lines if line.startswith("ran plan")]  # this output is discarded
