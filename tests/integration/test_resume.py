"""Runs killed before, in or after journal writes and device frames reach the same leaf or a declared end.

The tests take a sample of the moments; `pytest --every-moment tests/integration/test_resume.py` takes each.
"""

import itertools
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import NamedTuple

import pytest
from crash_cell import KilledError, World, process, restart_takes_a_while
from sample_tables import pushing_table, small_table, with_job
from written_journals import assert_sound

from runtime.errors import BrokenRunError
from runtime.execution.executor import RunOptions
from runtime.execution.handling import Handling
from runtime.execution.tips import TipArc
from runtime.journal.chain import records
from runtime.table import Place, Table
from runtime.traversal.decision import Policy
from runtime.traversal.results import Outcome

PATH = [(0, 1), (1, 0)]  # by both nodes of the small table to leaf 1
PLAIN = RunOptions(Policy.of("next", "next"), Handling())
LEVEL = Handling(regulated=True, arc=TipArc(level_mm=8.0))
CAREFUL = RunOptions(Policy.of("resqueeze,restart,next", "restart,next"), LEVEL)


def dragging_table() -> Table:
    """The small table with a drag after its root, to the place where the second node squeezes."""
    table = small_table()
    root = table.nodes[0]._replace(release=Place(12_000, -7_000))
    second = table.nodes[1]
    second = second._replace(squeeze=second.squeeze._replace(x_um=12_000, y_um=-7_000))
    return replace(table, nodes=(root, second))


@pytest.fixture(autouse=True)
def _quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Omits syncs to the disk: they protect from a power cut, not from the kill of a process."""
    monkeypatch.setattr(os, "fsync", lambda file: None)


Some = Callable[[int, int], range]


@pytest.fixture
def some(request: pytest.FixtureRequest) -> Some:
    """A function that selects moments: every `step`-th of them, or all with `--every-moment`."""
    every = request.config.getoption("--every-moment")
    return lambda moments, step: range(0, moments, 1 if every else step)


class Killed(NamedTuple):
    """A run that was killed, and the kinds of its complete records."""

    last: int  # the moment at which its process was killed
    world: World
    path: Path
    kinds: list[str]


Runs = Callable[[Table, int], Iterator[Killed]]


@pytest.fixture
def killed(some: Some, tmp_path: Path) -> Runs:
    """A function that yields runs of a table, each killed at another moment; no device moves any more."""

    def runs(table: Table, step: int) -> Iterator[Killed]:
        for last in some(moments_of(table, PLAIN, tmp_path / "whole.jsonl"), step):
            world, path = World(table, PATH), tmp_path / f"{last}.jsonl"
            with pytest.raises(KilledError):
                process(world, path, PLAIN, last=last)
            restart_takes_a_while(world)
            yield Killed(last, world, path, whole_kinds(path))

    return runs


def moments_of(table: Table, plan: RunOptions, path: Path) -> int:
    world = World(table, PATH)
    tally, moments = process(world, path, plan)
    assert tally.outcomes == {Outcome.LEAF: 1}
    assert world.wrongs == []
    return moments


def survive(table: Table, plan: RunOptions, path: Path, deaths: tuple, after_crash: str) -> tuple:
    """Runs a part in processes killed at the moments `deaths`, then to its end; returns outcome and leaf."""
    world = World(table, PATH)
    for last in (*deaths, None):
        try:
            process(world, path, plan, last=last, after_crash=after_crash)
            break
        except KilledError:
            restart_takes_a_while(world)
            if "end" in whole_kinds(path):
                break  # it was killed after its work was done
    assert world.wrongs == []
    assert_sound(path)
    ended = [entry for entry in records(path) if entry["kind"] == "outcome"]
    assert len(ended) <= 1
    return (ended[0]["outcome"], ended[0]["leaf"]) if ended else (None, None)


BOTH = pytest.mark.parametrize("table", [small_table(), dragging_table()], ids=["plain", "drags"])


@BOTH
@pytest.mark.parametrize("plan", [PLAIN, CAREFUL], ids=["direct", "regulated, level tips"])
def test_resume_run_killed_at_any_moment_reaches_same_leaf(table, plan, tmp_path, some):
    moments = moments_of(table, plan, tmp_path / "whole.jsonl")
    assert moments > 200
    for last in some(moments, 23):
        ended = survive(table, plan, tmp_path / f"{last}.jsonl", (last,), "resume")
        assert ended == ("leaf", 1), f"killed at moment {last} of {moments}"


@BOTH
def test_resume_run_killed_twice_reaches_same_leaf(table: Table, tmp_path: Path) -> None:
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for first, second in itertools.product(range(3, moments, 97), range(2, moments, 89)):
        path = tmp_path / f"{first}-{second}.jsonl"
        assert survive(table, PLAIN, path, (first, second), "resume") == ("leaf", 1), path


@pytest.mark.parametrize("table", [small_table(), pushing_table()], ids=["plain", "pushing"])
def test_restart_part_killed_at_any_moment_reaches_same_leaf(table, tmp_path, some):
    for last in some(moments_of(table, PLAIN, tmp_path / "whole.jsonl"), 29):
        path = tmp_path / f"{last}.jsonl"
        assert survive(table, PLAIN, path, (last,), "restart") == ("leaf", 1), last


def test_resume_run_killed_while_pushing_is_refused_and_repeats_no_push(killed):
    """Only a run killed while it pushed is refused; the others reach their leaf, with each push made once."""
    refused = 0
    for last, _, path, kinds in killed(pushing_table(), 23):
        path.unlink(missing_ok=True)
        if kinds[-1:] == ["pushing"]:
            refused += 1
            said = "while the part was pushed, and nobody knows where it lies"
            with pytest.raises(BrokenRunError, match=said):
                survive(pushing_table(), PLAIN, path, (last,), "resume")
            continue
        assert survive(pushing_table(), PLAIN, path, (last,), "resume") == ("leaf", 1), last
        if kinds[-1:] == ["placed"]:  # the first node's push and both of the second's
            assert whole_kinds(path).count("pushing") == 3
    assert refused > 2


def test_abort_after_kill_ends_run_in_journal_and_moves_nothing(killed):
    for _, world, path, begun in killed(small_table(), 23):
        stood = (world.at_mm, world.model.read_output())
        if not begun or "end" in begun or "outcome" in begun:
            continue
        with pytest.raises(BrokenRunError, match="nothing was moved"):
            process(world, path, PLAIN, after_crash="abort")
        assert (world.at_mm, world.model.read_output()) == stood
        last_kinds = whole_kinds(path)[-2:]
        assert last_kinds[-1] == "end"
        assert ("part" in begun) == (last_kinds[0] == "outcome")


def whole_kinds(path: Path) -> list[str]:
    """The kinds of a journal's records; a torn line at the end is left out."""
    data = path.read_bytes() if path.exists() else b""
    whole = path.with_suffix(".whole")
    whole.write_bytes(data[: data.rfind(b"\n") + 1])
    return [entry["kind"] for entry in records(whole)]


@BOTH
@pytest.mark.parametrize("height_mm", [10.0, 60.0])
def test_resume_hand_moved_since_kill_aborts_part(table, height_mm, killed):
    """Once the hand has been placed, the part continues only if the hand is where the run left it."""
    for last, world, path, kinds in killed(table, 29):
        world._grip_mm = None
        world.at_mm = (40.0, 30.0, height_mm, 0.0)
        stood = world.at_mm
        tally, _ = process(world, path, PLAIN)
        touched = "placed" in kinds and "outcome" not in kinds
        assert (Outcome.ABORTED in tally.outcomes) == touched, (last, kinds)
        if touched:
            assert world.at_mm == stood
            *_, ended = (entry for entry in records(path) if entry["kind"] == "outcome")
            assert "not where the run broke off" in ended["reason"]
            assert ended["safe_state"] == ["nothing was moved"]
        assert tally.exit_code in ({24} if touched else {0, 10})


@pytest.mark.parametrize(("share", "outcome"), [(0.5, Outcome.LEAF), (0.6, Outcome.ABORTED)])
def test_resume_hand_turned_by_half_a_turn_continues_if_fingers_close_alike(share, outcome, killed):
    table = with_job(small_table(), json.dumps({"gripper": {"upper_finger_share": share}}))
    holding = (run for run in killed(table, 7) if run.kinds[-1:] == ["squeeze"])
    ends = Counter[Outcome]()
    for _, world, path, _ in holding:
        world.at_mm = (*world.at_mm[:3], world.at_mm[3] + pi)
        ends.update(process(world, path, PLAIN)[0].outcomes)
    assert set(ends) == {outcome}


def test_resume_part_removed_from_fingers_aborts_part(killed):
    """The fingers closed further when the part was removed, so that the count differs from the journal."""
    refused = 0
    for _, world, path, kinds in killed(small_table(), 7):
        if kinds[-1:] != ["squeeze"] or world.model.read_output()[3] != 255:
            continue
        world.model.lose_object(world.time.now())
        restart_takes_a_while(world)
        tally, _ = process(world, path, PLAIN)
        assert tally.outcomes == {Outcome.ABORTED: 1}
        refused += 1
    assert refused


def test_resume_gripper_reset_since_kill_ends_with_code_and_no_motion(killed):
    codes = set()
    for _, world, path, _ in killed(small_table(), 17):
        world.model.write_output(0, bytes(6), world.time.now())
        stood = world.at_mm
        try:
            tally, _ = process(world, path, PLAIN)
            codes.add(tally.exit_code)
        except Exception as error:
            codes.add(error.exit_code)
        assert world.at_mm == stood
    assert codes == {20, 24}
