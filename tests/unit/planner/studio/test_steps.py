"""Planning as three commands: their order, what ends them, and how Stop reaches them."""

import json
import sys

import pytest

from planner.studio import steps

OBEDIENT = """
import pathlib, signal, sys, time
words = sys.argv[1:]
print("ran", words[0], flush=True)
if words[0] == "try" and "--budget=1" in words:
    pathlib.Path("a.stop").touch()
    try: time.sleep(60)
    except KeyboardInterrupt: print("kept", flush=True)
if words[0] == "try" and "--turn=0" not in words: pathlib.Path("a.msgpack").touch()
sys.exit(5 if "--scale=1" in words else 0)
"""


@pytest.fixture
def ran(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(steps, "COMMAND", [sys.executable, "-c", OBEDIENT])

    def run(*arguments):
        code = steps.main(["a", "a.dxf", *arguments])
        return code, capfd.readouterr().out.splitlines()

    return run


def test_the_commands_run_one_after_another(ran):
    code, lines = ran()
    assert code == 0
    assert [line for line in lines if line.startswith("ran")] == [
        "ran try",
        "ran report",
        "ran run",
    ]
    assert json.loads(lines[-1]) == {"exit": 0}


@pytest.mark.parametrize(("argument", "expected"), [("--turn=0", 0), ("--scale=1", 5)])
def test_without_a_table_or_after_a_failure_nothing_follows(ran, argument, expected):
    code, lines = ran(argument)
    assert code == expected
    assert [line for line in lines if line.startswith("ran")] == ["ran try"]


def test_stop_interrupts_the_search_and_the_rest_follows(ran, tmp_path):
    code, lines = ran("--budget=1")
    assert code == 0
    assert [line for line in lines if line[:1] != "{"] == [
        "ran try",
        "kept",
        "ran report",
        "ran run",
    ]
    assert not (tmp_path / "a.stop").exists()


def test_typed_is_what_a_shell_takes_for_the_same():
    words = ["try", "a b.dxf", "--radius=5", "-o", "a.toml"]
    assert steps.typed(words) == "squeezetree try 'a b.dxf' --radius 5 -o a.toml"
    assert steps.beginning("-a.dxf") == "./-a.dxf"
