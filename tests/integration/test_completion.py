"""Completion of all commands, asked for as a person does: in a bash on a terminal, by the Tab key."""

import os
import pty
import re
import select
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from runtime.commands import completion

ROOT = Path(__file__).parents[2]
WAIT_S = 30
SCRIPTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
PROMPT = b"ready> "


@pytest.fixture(scope="module")
def script() -> str:
    return completion.script(dict(completion.parsers()))


class Bash:
    """A bash on a terminal of its own."""

    def __init__(self, script: Path) -> None:
        self._ours, theirs = pty.openpty()
        environment = {"PATH": os.environ["PATH"], "TERM": "dumb", "PS1": PROMPT.decode()}
        words = ["bash", "--norc", "--noprofile", "-i"]
        self._process = subprocess.Popen(
            words,
            cwd=ROOT,
            env=environment,
            start_new_session=True,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
        )
        os.close(theirs)
        self._until(PROMPT)
        self._say(f"bind 'set enable-bracketed-paste off'; . {script}\n".encode())
        self._until(PROMPT)

    def completed(self, line: str) -> str:
        """The line after Tab is pressed at its end."""
        # The line is echoed and gone on with; a mark typed behind it tells where that ends.
        self._say(line.encode() + b"\t#END")
        told = self._until(b"#END")
        self._say(b"\x15\n")  # forget the line
        self._until(PROMPT)
        return told.removesuffix(b"#END").rpartition(PROMPT)[2].replace(b"\x07", b"").decode()

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._ours)

    def _say(self, words: bytes) -> None:
        os.write(self._ours, words)

    def _until(self, mark: bytes) -> bytes:
        told = b""
        while not told.endswith(mark):
            assert select.select([self._ours], [], [], WAIT_S)[0], told
            told += os.read(self._ours, 4096)
        return told


@pytest.fixture(scope="module")
def bash(script: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bash]:
    path = tmp_path_factory.mktemp("completion") / "script"
    path.write_text(script)
    started = Bash(path)
    yield started
    started.close()


def test_the_commands_are_those_that_are_installed() -> None:
    assert set(completion.COMMANDS) == set(SCRIPTS)


def test_each_parser_is_its_commands() -> None:
    record = dict(completion.parsers())
    assert set(record) == set(SCRIPTS)
    assert {name: made.prog for name, made in record.items()} == {name: name for name in SCRIPTS}


@pytest.mark.parametrize(
    ("line", "completed"),
    [
        ("grasp-runtime --watc", "grasp-runtime --watch "),
        (
            "grasp-runtime --after-crash res",
            "grasp-runtime --after-crash res",
        ),  # resume and restart
        ("grasp-runtime --after-crash resu", "grasp-runtime --after-crash resume "),
        ("plan-compile trees/rectangle/jo", "plan-compile trees/rectangle/job.toml "),
        (
            "plan-evaluate trees/rectangle/rectangle.m",
            "plan-evaluate trees/rectangle/rectangle.msgpack ",
        ),
        ("plan-compile JOB --cache-dir tree", "plan-compile JOB --cache-dir trees/"),
        ("plan-init part.dxf --gripper hand", "plan-init part.dxf --gripper hand-e "),
        ("plan-simulate --nom", "plan-simulate --nominal "),
        ("plan-identify --fric", "plan-identify --friction-n "),
        ("plan-report --jour", "plan-report --journal "),
        ("plan-export t.msgpack --to c", "plan-export t.msgpack --to c99 "),
        ("grasp-doctor --cal", "grasp-doctor --calibration "),
        ("grasp-calibrate cam", "grasp-calibrate camera "),
        ("grasp-calibrate camera --board-", "grasp-calibrate camera --board-height "),
        ("grasp-calibrate width --cur", "grasp-calibrate width --current "),
        ("grasp-journal rep", "grasp-journal replay "),
        ("grasp-journal show --outc", "grasp-journal show --outcome "),
        ("grasp-cell --until", "grasp-cell --until-stdin-closes "),
        ("grasp-audit report --expo", "grasp-audit report --export "),
        ("grasp-audit judge --pic", "grasp-audit judge --pictures "),
        ("squeezetree-completion --he", "squeezetree-completion --help "),
    ],
)
def test_tab_completes(bash: Bash, line: str, completed: str) -> None:
    assert bash.completed(line) == completed


def test_every_option_of_every_command_is_in_the_script(script: str) -> None:
    for name, made in completion.parsers():
        for action in completion._actions(made):
            for option in action.option_strings:
                assert re.search(rf"(?<![-a-z]){option}(?![-a-z])", script), (name, option)


def test_the_documented_line_is_one_that_bash_takes(script: str, tmp_path: Path) -> None:
    (line,) = [result.strip() for result in completion.EPILOG.splitlines() if " > ~/" in result]
    assert line in (ROOT / "README.md").read_text()
    (tmp_path / "script").write_text(script)
    made = f"{completion.NAME}() {{ cat ~/script; }}"
    command = [f"HOME={tmp_path}", made, line, ". ~/.bashrc", "complete -p grasp-cell"]
    done = subprocess.run(
        ["bash", "-c", "\n".join(command)],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=True,
    )
    assert re.search(r"-F _shtab_grasp_cell grasp-cell", done.stdout)


def test_commands_whose_libraries_are_not_installed_are_left_out() -> None:
    code = "import sys; sys.modules['numpy'] = None; from runtime.commands import completion"
    code += "; sys.exit(completion.main())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    registered = set(re.findall(r"^complete .* ([a-z-]+)$", done.stdout, re.MULTILINE))
    gone = {name for name in SCRIPTS if name.startswith("plan-")} | {"grasp-audit"}
    assert registered == set(SCRIPTS) - gone


def test_without_shtab_one_line_names_the_extra() -> None:
    code = "import sys; sys.modules['shtab'] = None; from runtime.commands import completion"
    code += "; sys.exit(completion.main())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "squeezetree[completion]" in done.stderr
