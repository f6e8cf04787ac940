"""SIGKILL before, in and after journal writes and device frames: the same leaf, or a declared end.

At a sample of the moments; `pytest --every-moment tests/integration/test_resume.py` takes each.
"""

import itertools
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
from crash_cell import KilledError, World, process, restart_takes_a_while
from sample_tables import pushing_table, small_table
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
    """The small table, whose root drags what it holds to where its second node squeezes."""
    table = small_table()
    root = table.nodes[0]._replace(release=Place(12_000, -7_000))
    second = table.nodes[1]
    second = second._replace(squeeze=second.squeeze._replace(x_um=12_000, y_um=-7_000))
    return replace(table, nodes=(root, second))


@pytest.fixture(autouse=True)
def _quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a killed process has written stays written; only a power cut asks for the sync."""
    monkeypatch.setattr(os, "fsync", lambda file: None)


Some = Callable[[int, int], range]


@pytest.fixture
def some(request: pytest.FixtureRequest) -> Some:
    """Some of so many moments: one in each step, or every one if that is asked for."""
    every = request.config.getoption("--every-moment")
    return lambda moments, step: range(0, moments, 1 if every else step)


class Killed(NamedTuple):
    """A run that was killed, and the kinds of its whole records."""

    last: int  # moment of its process
    world: World
    path: Path
    kinds: list[str]


Runs = Callable[[Table, int], Iterator[Killed]]


@pytest.fixture
def killed(some: Some, tmp_path: Path) -> Runs:
    """Runs of a table that are killed at some moments, one in each step; motions have ended since."""

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
    """Processes that die at the given moments, one after the other, and one that lives; the part's end."""
    world = World(table, PATH)
    for last in (*deaths, None):
        try:
            process(world, path, plan, last=last, after_crash=after_crash)
            break
        except KilledError:
            restart_takes_a_while(world)
            if "end" in whole_kinds(path):
                break  # it was killed when all was done
    assert world.wrongs == []
    assert_sound(path)
    ended = [entry for entry in records(path) if entry["kind"] == "outcome"]
    assert len(ended) <= 1
    return (ended[0]["outcome"], ended[0]["leaf"]) if ended else (None, None)


BOTH = pytest.mark.parametrize("table", [small_table(), dragging_table()], ids=["plain", "drags"])


@BOTH
@pytest.mark.parametrize("plan", [PLAIN, CAREFUL], ids=["direct", "regulated, level tips"])
def test_a_run_killed_at_any_moment_and_resumed_reaches_the_same_leaf(table, plan, tmp_path, some):
    moments = moments_of(table, plan, tmp_path / "whole.jsonl")
    assert moments > 200
    for last in some(moments, 23):
        ended = survive(table, plan, tmp_path / f"{last}.jsonl", (last,), "resume")
        assert ended == ("leaf", 1), f"killed at moment {last} of {moments}"


@BOTH
def test_a_resumed_run_may_be_killed_again(table: Table, tmp_path: Path) -> None:
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for first, second in itertools.product(range(3, moments, 97), range(2, moments, 89)):
        path = tmp_path / f"{first}-{second}.jsonl"
        assert survive(table, PLAIN, path, (first, second), "resume") == ("leaf", 1), path


@pytest.mark.parametrize("table", [small_table(), pushing_table()], ids=["plain", "pushing"])
def test_a_part_that_is_started_over_reaches_the_same_leaf(table, tmp_path, some):
    for last in some(moments_of(table, PLAIN, tmp_path / "whole.jsonl"), 29):
        path = tmp_path / f"{last}.jsonl"
        assert survive(table, PLAIN, path, (last,), "restart") == ("leaf", 1), last


def test_a_run_killed_while_it_pushed_is_not_resumed_and_no_push_is_repeated(killed):
    """What it broke off at may be started over."""
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
        if kinds[-1:] == ["placed"]:  # once the first node's pushes, once both of the second's
            assert whole_kinds(path).count("pushing") == 3
    assert refused > 2


def test_a_run_that_is_given_up_says_so_and_moves_nothing(killed):
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
    """The kinds of the records before a torn line."""
    data = path.read_bytes() if path.exists() else b""
    whole = path.with_suffix(".whole")
    whole.write_bytes(data[: data.rfind(b"\n") + 1])
    return [entry["kind"] for entry in records(whole)]


@BOTH
@pytest.mark.parametrize("height_mm", [10.0, 60.0])
def test_a_hand_that_was_moved_meanwhile_is_a_declared_end(table, height_mm, killed):
    """Once a reading is believed, the part is gone on with only where the hand was left, held or let go."""
    for last, world, path, kinds in killed(table, 29):
        world._grip_mm = None
        world.at_mm = (40.0, 30.0, height_mm, 0.0)
        stood = world.at_mm
        tally, _ = process(world, path, PLAIN)
        touched = "placed" in kinds and "outcome" not in kinds
        assert (Outcome.ABORTED in tally.outcomes) == touched, (last, kinds)
        if touched:
            assert world.at_mm == stood
            reasons = [entry["reason"] for entry in records(path) if entry["kind"] == "outcome"]
            assert "not where the run broke off" in reasons[-1]
        assert tally.exit_code in ({24} if touched else {0, 10})


def test_a_part_that_was_taken_out_of_the_fingers_is_not_answered_as_the_old_one(killed):
    """The fingers closed on as the part went: count and journal differ."""
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


def test_a_gripper_that_lost_its_power_with_the_part_in_it_is_a_declared_end(killed):
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
