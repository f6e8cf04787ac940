"""Watching a real run: the page follows it, and who does not ask pays nothing."""

import contextlib
import json
import re
import subprocess
import sys
import threading
import urllib.request
from itertools import pairwise
from pathlib import Path

import pytest
from sample_tables import small_table

from runtime.cli import main
from runtime.table import dump

ROOT = Path(__file__).parents[2]
WAIT_S = 60
ENDED = {0, 10, 11, 20, 21, 22}
"""A starved machine may make a simulated device late, which is a fault; what is seen of a run is the same."""
LOADED = """
import sys
import runtime.cli
code = runtime.cli.main(sys.argv[1:])
watched = ("runtime.monitoring.live", "numpy")
print([name for name in watched if name in sys.modules], file=sys.stderr)
sys.exit(code)
"""


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    dump(small_table(), tmp_path / "small.msgpack")
    return [
        *(
            "--tree",
            str(tmp_path / "small.msgpack"),
            "--port",
            "sim",
            "--world",
            "runtime.devices.rehearsal:make",
        ),
        *("--journal", str(tmp_path / "journal.jsonl"), "--time-scale", "20"),
    ]


def run(words: list[str]) -> subprocess.CompletedProcess[str]:
    """Run and tell in the last line what of the views was loaded."""
    command = [sys.executable, "-c", LOADED, *words]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=WAIT_S, check=False
    )


def test_a_run_that_nobody_watches_and_a_pipe_load_no_view(words: list[str]) -> None:
    assert run([*words[:-1], "max"]).stderr.splitlines()[-1] == "[]"
    done = run(words)
    assert done.stderr.splitlines()[-1] == "[]"
    assert "part 1: " in done.stdout
    assert "\x1b" not in done.stdout


def test_the_page_follows_the_run(words: list[str]) -> None:
    words = [*words, "--count", "100000", "--json", "--http", "0"]
    process = subprocess.Popen(
        [sys.executable, "-m", "runtime.cli", *words],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    with process, process.stderr as output:
        url = next(
            matches[0]
            for line in output
            if (matches := re.findall(r"http://127\.0\.0\.1:\d+/", line))
        )
        seen: list[dict[str, object]] = []
        with contextlib.suppress(OSError):
            while not seen or seen[-1]["part"] < 3:  # type: ignore[operator]
                with urllib.request.urlopen(f"{url}status.json", timeout=WAIT_S) as answer:
                    seen.append(json.load(answer))
                threading.Event().wait(0.02)
        process.terminate()
        process.communicate(timeout=WAIT_S)
    assert process.returncode in ENDED | {40}
    parts = [int(str(state["part"])) for state in seen]
    assert parts == sorted(parts)
    assert {state["node"] for state in seen} >= {0}
    for state in seen:
        steps = state["steps"]
        assert isinstance(steps, list)
        for step, following in pairwise(steps):
            assert step["target"] == following["node"]
    with pytest.raises(OSError, match="refused"), urllib.request.urlopen(url, timeout=WAIT_S):
        pass


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (["--http", "no port"], "write PORT or HOST:PORT"),
        (["--http", "192.0.2.1:0"], "name an address of this machine"),
        (["--http", "0", "--dry-run"], "leave it out with --check and --dry-run"),
    ],
)
def test_what_cannot_be_shown_is_one_line_before_anything_starts(
    words: list[str], capfd: pytest.CaptureFixture[str], wrong: list[str], reason: str
) -> None:
    assert main([*words, *wrong]) == 2
    printed = capfd.readouterr()
    assert printed.err.count("\n") == 1
    assert reason in printed.err
    assert "simulated cell" not in printed.out
    assert not Path(words[words.index("--journal") + 1]).exists()
