"""The live page of a run, by `--http`."""

import contextlib
import json
import re
import subprocess
import threading
import urllib.request
from itertools import pairwise
from pathlib import Path

import pytest
from programs import REHEARSAL, RUNTIME, WAIT_S, called, started

from runtime.cli import main

ENDED = {0, 10, 11, 20, 21, 22}
"""Exit codes of a run; on a busy machine a simulated device may be late, which is a fault."""


@pytest.fixture
def words(tree: Path) -> list[str]:
    journal = str(tree.with_name("journal.jsonl"))
    words = ["--tree", str(tree), "--port", "sim", *REHEARSAL, "--journal", journal]
    return [*words, "--time-scale", "20"]


def test_http_status_follows_run(words: list[str]) -> None:
    words = [*words, "--count", "100000", "--json", "--http", "0"]
    process = started([*RUNTIME, *words], stdout=subprocess.DEVNULL)
    assert process.stderr is not None
    with process, process.stderr as output:
        addresses = (re.findall(r"http://127\.0\.0\.1:\d+/", line) for line in output)
        url = next(each[0] for each in addresses if each)
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
def test_http_invalid_option_is_refused_before_start(words, wrong, reason):
    printed = called(main, *words, *wrong)
    assert (printed.code, printed.one_line) == (2, True)
    assert reason in printed.err
    assert "simulated cell" not in printed.out
    assert not Path(words[words.index("--journal") + 1]).exists()
