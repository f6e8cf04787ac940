"""What is done about a run that broke off, before any device is opened."""

import base64
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sample_tables import small_table
from written_journals import Quiet, write_run

from runtime.devices.clock import SystemClock
from runtime.errors import BrokenRunError
from runtime.execution import crash
from runtime.execution.delivery import from_text
from runtime.journal.chain import Journal, records, verify
from runtime.table import dumps

STAMP = SystemClock().stamp
RESUME_WITHIN_S = 300.0
TABLE = dumps(small_table())
FIELDS = {"on_reject": "next", "on_unresolved": "next"}


def broken(path: Path, lines: int) -> Path:
    """A run that broke off after so many records."""
    write_run(path)
    kept = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(kept[:lines]))
    return path


def look(path: Path, policy: str, table: bytes = TABLE, late_s: float = 0.0, **fields: object):
    now = (datetime.now(UTC) + timedelta(seconds=late_s)).isoformat()
    with Journal(path, STAMP) as journal:
        return crash.look(
            *(journal, table, {**FIELDS, **fields}, policy, Quiet()), now=now, most_s=RESUME_WITHIN_S
        )


def test_a_run_that_ended_is_nothing_to_go_on_with(tmp_path: Path) -> None:
    assert look(write_run(tmp_path / "j.jsonl"), crash.ABORT) is None


@pytest.mark.parametrize(
    ("lines", "part", "steps"), [(1, None, 0), (2, 1, 0), (4, 1, 1), (5, None, 0), (9, 2, 1)]
)
def test_where_it_broke_off_is_known(tmp_path: Path, lines: int, part: int | None, steps: int) -> None:
    seen = look(broken(tmp_path / "j.jsonl", lines), crash.RESUME)
    assert seen is not None
    assert (seen.part, len(seen.steps)) == (part, steps)


def test_giving_up_is_recorded_and_ends_the_run(tmp_path: Path) -> None:
    path = broken(tmp_path / "j.jsonl", 4)
    with pytest.raises(
        BrokenRunError, match="at part 1, after 1 squeeze; it is given up and nothing was moved"
    ):
        look(path, crash.ABORT)
    assert [entry["kind"] for entry in records(path)][-2:] == ["outcome", "end"]
    assert verify(path).closed
    assert look(path, crash.ABORT) is None


def test_starting_over_forgets_the_path_and_not_what_is_held(tmp_path: Path) -> None:
    seen = look(broken(tmp_path / "j.jsonl", 4), crash.RESTART)
    assert seen is not None
    assert (seen.steps, seen.traversal.node) == ([], 0)
    assert seen.held_at is not None


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"table": b"another"}, "table"),
        ({"widths_um": [1, 2]}, "calibration"),
        ({"middle_um": 1500}, "middle of the fingers"),
        ({"on_reject": "stop"}, "--on-reject"),
        ({"on_unresolved": "stop"}, "--on-unresolved"),
        ({"delivery": from_text("50,0,90").told()}, "--deliver"),
    ],
)
def test_a_run_is_gone_on_with_as_it_was_begun(tmp_path: Path, changed: dict, what: str) -> None:
    path = broken(tmp_path / "j.jsonl", 4)
    with pytest.raises(BrokenRunError, match=f"had another {what}") as refused:
        look(path, crash.RESUME, **changed)
    assert refused.value.exit_code == 25
    assert not verify(path).closed


@pytest.mark.parametrize(("late_s", "says"), [(400.0, "s ago; after 300 s"), (-60.0, "went back")])
@pytest.mark.parametrize("policy", [crash.RESUME, crash.RESTART])
def test_a_part_of_long_ago_or_of_tomorrow_is_not_gone_on_with(
    tmp_path: Path, policy: str, late_s: float, says: str
) -> None:
    path = broken(tmp_path / "j.jsonl", 4)
    with pytest.raises(BrokenRunError, match=says) as refused:
        look(path, policy, late_s=late_s)
    assert refused.value.exit_code == 25
    assert not verify(path).closed


def test_between_two_parts_there_is_nothing_that_could_be_too_old(tmp_path: Path) -> None:
    seen = look(broken(tmp_path / "j.jsonl", 5), crash.RESUME, late_s=1e6)
    assert seen is not None
    assert seen.part is None


@pytest.mark.parametrize("policy", [crash.RESUME, crash.ABORT])
def test_a_run_that_its_own_counts_do_not_justify_is_not_resumed(tmp_path: Path, policy: str) -> None:
    path = tmp_path / "j.jsonl"
    with Journal(path, STAMP) as journal:
        journal.header(TABLE, FIELDS)
        journal.record("part", {"part": 1})
        journal.record("placed", {"part": 1, "number": 1, "node": 1})
    with pytest.raises(BrokenRunError, match="the path leads to node 0"):
        look(path, policy)
    assert verify(path).closed == (policy == crash.ABORT)


def test_going_on_is_recorded_with_what_was_cut_off(tmp_path: Path) -> None:
    path = broken(tmp_path / "j.jsonl", 4)
    with path.open("ab") as file:
        file.write(b'{"seq":4,"ti')
    with Journal(path, STAMP) as journal:
        seen = crash.look(
            *(journal, TABLE, FIELDS, crash.RESUME, Quiet()), now=STAMP(), most_s=RESUME_WITHIN_S
        )
        crash.begin(journal, seen, TABLE, FIELDS, crash.RESUME)
    last = list(records(path))[-1]
    assert (last["kind"], last["part"], last["how"], last["cut_bytes"]) == ("resume", 1, "resume", 12)


def test_the_header_of_a_new_run_holds_the_table(tmp_path: Path) -> None:
    with Journal(tmp_path / "j.jsonl", STAMP) as journal:
        crash.begin(journal, None, TABLE, FIELDS, crash.ABORT)
    (header,) = records(tmp_path / "j.jsonl")
    assert base64.b64decode(str(header["table_base64"])) == TABLE
