"""SIGKILL before, in and after journal writes and device frames: the same leaf, or a declared end.

At a sample of the moments; `pytest --every-moment tests/integration/test_resume.py` takes each.
"""

import itertools
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from crash_cell import KilledError, World, process, restart_takes_a_while
from fake_cell import Deaf
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
CAREFUL = RunOptions(
    Policy.of("resqueeze,restart,next", "restart,next"),
    Handling(regulated=True, arc=TipArc(level_mm=8.0)),
)


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


@pytest.fixture
def some(request: pytest.FixtureRequest) -> Callable[..., range]:
    """Makes a range of moments: of its steps, or of ones if every moment is asked for."""
    every = request.config.getoption("--every-moment")
    return lambda first, moments, step: range(first, moments, 1 if every else step)


def moments_of(table: Table, plan: RunOptions, path: Path) -> int:
    world = World(table, PATH)
    tally, moments = process(world, path, Deaf(), plan)
    assert tally.outcomes == {Outcome.LEAF: 1}
    assert world.wrongs == []
    return moments


def survive(
    table: Table, plan: RunOptions, path: Path, deaths: tuple[int, ...], after_crash: str
) -> tuple:
    """Processes that die at the given moments, one after the other, and one that lives; the part's end."""
    world = World(table, PATH)
    for last in (*deaths, None):
        try:
            process(world, path, Deaf(), plan, last=last, after_crash=after_crash)
            break
        except KilledError:
            restart_takes_a_while(world)
            if "end" in [entry["kind"] for entry in _whole_records(path)]:
                break  # it was killed when all was done
    assert world.wrongs == []
    assert_sound(path)
    ended = [entry for entry in records(path) if entry["kind"] == "outcome"]
    assert len(ended) <= 1
    return (ended[0]["outcome"], ended[0]["leaf"]) if ended else (None, None)


@pytest.mark.parametrize(
    ("table", "plan"),
    [
        (small_table(), PLAIN),
        (small_table(), CAREFUL),
        (dragging_table(), PLAIN),
        (dragging_table(), CAREFUL),
    ],
    ids=["plain", "regulated, level tips", "dragging", "dragging, regulated, level tips"],
)
def test_a_run_killed_at_any_moment_and_resumed_reaches_the_same_leaf(
    table: Table, plan: RunOptions, tmp_path: Path, some: Callable[..., range]
) -> None:
    moments = moments_of(table, plan, tmp_path / "whole.jsonl")
    assert moments > 200
    for last in some(0, moments, 23):
        ended = survive(table, plan, tmp_path / f"{last}.jsonl", (last,), "resume")
        assert ended == ("leaf", 1), f"killed at moment {last} of {moments}"


@pytest.mark.parametrize("table", [small_table(), dragging_table()], ids=["plain", "dragging"])
def test_a_resumed_run_may_be_killed_again(table: Table, tmp_path: Path) -> None:
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for first, second in itertools.product(range(3, moments, 97), range(2, moments, 89)):
        path = tmp_path / f"{first}-{second}.jsonl"
        assert survive(table, PLAIN, path, (first, second), "resume") == ("leaf", 1), path


@pytest.mark.parametrize("table", [small_table(), pushing_table()], ids=["plain", "pushing"])
def test_a_part_that_is_started_over_reaches_the_same_leaf(
    table: Table, tmp_path: Path, some: Callable[..., range]
) -> None:
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for last in some(0, moments, 29):
        path = tmp_path / f"{last}.jsonl"
        assert survive(table, PLAIN, path, (last,), "restart") == ("leaf", 1), last


def test_a_run_killed_while_it_pushed_is_not_resumed_but_may_be_started_over(
    tmp_path: Path, some: Callable[..., range]
) -> None:
    table, refused = pushing_table(), 0
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for last in some(0, moments, 23):
        path, world = tmp_path / f"{last}.jsonl", World(table, PATH)
        with pytest.raises(KilledError):
            process(world, path, Deaf(), PLAIN, last=last)
        pushing = [entry["kind"] for entry in _whole_records(path)][-1:] == ["pushing"]
        path.unlink(missing_ok=True)
        if pushing:
            with pytest.raises(
                BrokenRunError, match="while the part was pushed, and nobody knows where it lies"
            ):
                survive(table, PLAIN, path, (last,), "resume")
            refused += 1
        else:
            assert survive(table, PLAIN, path, (last,), "resume") == ("leaf", 1), last
    assert refused > 2


def test_a_squeeze_cut_short_is_repeated_without_its_pushes(
    tmp_path: Path, some: Callable[..., range]
) -> None:
    table = pushing_table()
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for last in some(0, moments, 23):
        path = tmp_path / f"{last}.jsonl"
        with pytest.raises(KilledError):
            process(World(table, PATH), path, Deaf(), PLAIN, last=last)
        before = [entry["kind"] for entry in _whole_records(path)]
        path.unlink(missing_ok=True)
        if before[-1:] == ["placed"]:
            assert survive(table, PLAIN, path, (last,), "resume") == ("leaf", 1), last
            kinds = [entry["kind"] for entry in records(path)]
            assert kinds.count("pushing") == 3  # once the first node's, once both of the second's


def test_a_run_that_is_given_up_says_so_and_moves_nothing(
    tmp_path: Path, some: Callable[..., range]
) -> None:
    moments = moments_of(small_table(), PLAIN, tmp_path / "whole.jsonl")
    for last in some(0, moments, 23):
        world, path = World(small_table(), PATH), tmp_path / f"{last}.jsonl"
        with pytest.raises(KilledError):
            process(world, path, Deaf(), PLAIN, last=last)
        restart_takes_a_while(world)
        stood = (world.at_mm, world.model.read_output())
        begun = [entry["kind"] for entry in _whole_records(path)]
        if not begun or "end" in begun:
            continue
        if "outcome" in begun:
            assert records(path)
            continue
        with pytest.raises(BrokenRunError, match="nothing was moved"):
            process(world, path, Deaf(), PLAIN, after_crash="abort")
        assert (world.at_mm, world.model.read_output()) == stood
        last_kinds = [entry["kind"] for entry in records(path)][-2:]
        assert last_kinds[-1] == "end"
        assert ("part" in begun) == (last_kinds[0] == "outcome")


def _whole_records(path: Path) -> list[dict]:
    """The records before a torn line."""
    data = path.read_bytes() if path.exists() else b""
    whole = path.with_suffix(".whole")
    whole.write_bytes(data[: data.rfind(b"\n") + 1])
    return list(records(whole))


@pytest.mark.parametrize("table", [small_table(), dragging_table()], ids=["plain", "dragging"])
def test_a_hand_that_was_moved_meanwhile_is_a_declared_end(
    table: Table, tmp_path: Path, some: Callable[..., range]
) -> None:
    """Once a reading is believed, the part is gone on with only where the hand was left, held or let go."""
    moments = moments_of(table, PLAIN, tmp_path / "whole.jsonl")
    for last, height_mm in itertools.product(some(0, moments, 29), (10.0, 60.0)):
        world, path = World(table, PATH), tmp_path / f"{last}-{height_mm:g}.jsonl"
        with pytest.raises(KilledError):
            process(world, path, Deaf(), PLAIN, last=last)
        restart_takes_a_while(world)
        world._grip_mm = None
        world.at_mm = (40.0, 30.0, height_mm, 0.0)
        kinds = [entry["kind"] for entry in _whole_records(path)]
        tally, _ = process(world, path, Deaf(), PLAIN)
        touched = "placed" in kinds and "outcome" not in kinds
        assert (Outcome.ABORTED in tally.outcomes) == touched, (last, kinds)
        assert tally.exit_code in ({24} if touched else {0, 10})


def test_a_part_that_was_taken_out_of_the_fingers_is_not_answered_as_the_old_one(
    tmp_path: Path, some: Callable[..., range]
) -> None:
    """The fingers closed on as the part went: count and journal differ."""
    moments = moments_of(small_table(), PLAIN, tmp_path / "whole.jsonl")
    refused = 0
    for last in some(0, moments, 7):
        world, path = World(small_table(), PATH), tmp_path / f"{last}.jsonl"
        with pytest.raises(KilledError):
            process(world, path, Deaf(), PLAIN, last=last)
        restart_takes_a_while(world)
        if _whole_records(path)[-1:] and _whole_records(path)[-1]["kind"] == "squeeze":
            if world.model.read_output()[3] != 255:
                continue
            world.model.lose_object(world.time.now())
            restart_takes_a_while(world)
            tally, _ = process(world, path, Deaf(), PLAIN)
            assert tally.outcomes == {Outcome.ABORTED: 1}
            refused += 1
    assert refused


def test_a_gripper_that_lost_its_power_with_the_part_in_it_is_a_declared_end(
    tmp_path: Path, some: Callable[..., range]
) -> None:
    moments = moments_of(small_table(), PLAIN, tmp_path / "whole.jsonl")
    codes = set()
    for last in some(0, moments, 17):
        world, path = World(small_table(), PATH), tmp_path / f"{last}.jsonl"
        with pytest.raises(KilledError):
            process(world, path, Deaf(), PLAIN, last=last)
        world.model.write_output(0, bytes(6), world.time.now())
        stood = world.at_mm
        try:
            tally, _ = process(world, path, Deaf(), PLAIN)
            codes.add(tally.exit_code)
        except Exception as error:
            codes.add(error.exit_code)
        assert world.at_mm == stood
    assert codes == {20, 24}
