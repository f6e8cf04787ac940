"""Completion of commands by the Tab key, in a bash on a terminal."""

import os
import pty
import select
import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_parsers import parsers
from programs import WAIT_S, started

PROMPT = b"ready> "
LFLAG = 3


def printed(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The completion script of a command."""
    with pytest.raises(SystemExit) as ended:
        parsers()[name].parse_args(["--print-completion", "bash"])
    assert ended.value.code == 0
    return capsys.readouterr().out


class Bash:
    """An interactive bash on a pseudo-terminal."""

    def __init__(self, script: Path) -> None:
        self._ours, theirs = pty.openpty()
        environment = {"PATH": os.environ["PATH"], "TERM": "dumb", "PS1": PROMPT.decode()}
        words = ("bash", "--norc", "--noprofile", "-i")
        streams = dict.fromkeys(("stdin", "stdout", "stderr"), theirs)
        self._process = started(words, env=environment, start_new_session=True, **streams)
        os.close(theirs)
        self._until(PROMPT)
        self._say(f"bind 'set enable-bracketed-paste off'; . {script}\n".encode())
        self._until(PROMPT)

    def completed(self, line: str) -> str:
        """The line after Tab is pressed at its end."""
        while termios.tcgetattr(self._ours)[LFLAG] & termios.ICANON:  # readline does not listen yet
            time.sleep(0.01)
        # Bash echoes the line and its completion; the mark typed after Tab shows where they end.
        self._say(line.encode() + b"\t#END")
        echo = self._until(b"#END")
        # Clear the line. The prompt may be drawn twice meanwhile, but the output of a command appears once.
        self._say(b"\x15echo '#NE''XT'\n")
        self._until(b"#NEXT\r\n" + PROMPT)
        return echo.removesuffix(b"#END").rpartition(PROMPT)[2].replace(b"\x07", b"").decode()

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._ours)

    def _say(self, words: bytes) -> None:
        os.write(self._ours, words)

    def _until(self, mark: bytes) -> bytes:
        echo = b""
        while not echo.endswith(mark):
            assert select.select([self._ours], [], [], WAIT_S)[0], echo
            echo += os.read(self._ours, 4096)
        return echo


@pytest.fixture
def bash(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Iterator[Bash]:
    path = tmp_path / "script"
    names = ("grasp-runtime", "plan-compile", "grasp-journal", "squeezetree")
    path.write_text("\n".join(printed(name, capsys) for name in names))
    started = Bash(path)
    yield started
    started.close()


def test_bash_completion_completes_options_values_files_and_subcommands(bash: Bash) -> None:
    for line, completed in (
        ("grasp-runtime --htt", "grasp-runtime --http "),
        ("grasp-runtime --after-crash res", "grasp-runtime --after-crash res"),  # two values
        ("grasp-runtime --after-crash resu", "grasp-runtime --after-crash resume "),
        ("plan-compile trees/rectangle/jo", "plan-compile trees/rectangle/job.toml "),
        ("grasp-journal rep", "grasp-journal replay "),
        ("grasp-journal show --outc", "grasp-journal show --outcome "),
        ("squeezetree eval", "squeezetree evaluate "),
    ):
        assert bash.completed(line) == completed


def test_print_completion_script_lists_all_options_of_command(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name, parser in parsers().items():
        script = printed(name, capsys)
        for action in parser._actions:
            assert all(option in script for option in action.option_strings), name
