"""The terminal's picture: which lines of a tree are shown, and that the loop never waits for a terminal."""

import contextlib
import io
import os
import pty
import threading
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console as Terminal
from sample_tables import small_table
from written_journals import Quiet

from runtime.execution.events import Phase, Sighting, Tally
from runtime.monitoring.live.rows import Outline
from runtime.monitoring.live.terminal import View, picture
from runtime.monitoring.status import Status
from runtime.traversal.results import Outcome, PartResult, Step


def fed() -> Status:
    status, table = Status("small.msgpack", "ab" * 32, 958_000), small_table()
    status.phase(1, Phase.SQUEEZE, 0)
    first = Step(1, 0, table.nodes[0].squeeze, 150, 30_200, 1, None)
    second = Step(2, 1, table.nodes[1].squeeze, 174, 20_969, ~1, None)
    for step in (first, second):
        status.step(step)
    status.part(replace(PartResult.of(1, Outcome.LEAF, [first, second], None), audit="pass"))
    status.phase(2, Phase.SQUEEZE, 0)
    status.step(first)
    status.phase(2, Phase.PLACE, 1)
    return status


@pytest.mark.parametrize(("encoding", "here"), [("utf-8", "▶"), ("ascii", ">")])
def test_the_picture_tells_node_width_outcomes_and_parts(encoding, here):
    bare = io.TextIOWrapper(io.BytesIO(), encoding)
    terminal = Terminal(file=bare, width=100, height=30, force_terminal=True, color_system=None)
    terminal.print(picture(Outline(small_table()), "small.msgpack", fed().as_object(), terminal))
    bare.flush()
    output = bare.buffer.getvalue().decode(encoding)
    assert "part 2  place  last width 30.20 mm  3 squeezes" in output
    assert "1 LEAF  0 REJECT  0 UNRESOLVED" in output
    (now,) = [line for line in output.splitlines() if line.startswith(here)]
    assert "node 1, squeeze at (1.0, -2.0) mm, 90.0 deg" in now
    assert "29.0 to 31.0 mm, 40.0 %" in now
    assert "leaf 2, unresolved" in output
    assert "part 1: LEAF 1, 2 squeezes, audit pass" in output


def test_a_terminal_that_takes_nothing_holds_nobody_up(monkeypatch):
    monkeypatch.setattr("runtime.monitoring.live.terminal.END_S", 0.1)
    monkeypatch.setenv("TERM", "xterm")
    ours, theirs = pty.openpty()  # whose other end is never read
    result = PartResult.of(1, Outcome.REJECT, [], "nothing")
    stuck = threading.Event()
    stream = os.fdopen(theirs, "w")
    view = View(small_table(), "small.msgpack", fed(), Quiet(), stream)
    with view:
        for _ in range(3000):
            view.note("x" * 100)
            view.part(result, Sighting(None, None, None, 0))
        stuck.wait(0.3)
        view.summary(Tally(), Path("j"))
    assert view._thread.is_alive()
    os.close(ours)  # hung up: what it was writing fails, and it ends
    view._thread.join(20)
    assert not view._thread.is_alive()
    with contextlib.suppress(OSError):  # what it could not write
        stream.close()
