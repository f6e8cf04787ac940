"""The handling of a run that broke off, before any device is opened."""

import hashlib
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from fake_cell import Deaf
from sample_tables import small_table
from written_journals import write_run

from runtime.devices.clock import SystemClock
from runtime.errors import BrokenRunError
from runtime.execution import crash
from runtime.execution.delivery import from_text
from runtime.journal.chain import Journal, records, verify
from runtime.journal.lines import Entry
from runtime.table import dumps

STAMP = SystemClock().stamp
TABLE = dumps(small_table())
FIELDS = {"on_reject": "next", "on_unresolved": "next"}


def broken(path: Path, lines: int) -> Path:
    """A journal whose run broke off after its first `lines` records."""
    write_run(path)
    kept = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(kept[:lines]))
    return path


def header(table: bytes = TABLE) -> dict[str, object]:
    return {**FIELDS, "table_sha256": hashlib.sha256(table).hexdigest()}


def look(path: Path, policy: str, now: Entry | None = None, table: bytes = TABLE, **fields: object):
    up = dict(moment() if now is None else now)
    time = str(up.pop("time", ""))
    with Journal(path, lambda: time, lambda: up) as journal:
        return crash.look(journal, {**header(table), **fields}, policy, Deaf(), 300.0)


def moment(wall_s: float = 0.0, up_s: float = 0.0) -> dict[str, object]:
    """The present moment, but with a date that is `wall_s` later and an uptime that is `up_s` longer."""
    uptime = SystemClock().uptime()
    date = datetime.now(UTC) + timedelta(seconds=wall_s)
    return {**uptime, "time": date.isoformat(), "up_s": float(uptime["up_s"]) + up_s}


def test_look_ended_run_is_none(tmp_path):
    assert look(write_run(tmp_path / "j.jsonl"), crash.ABORT) is None


@pytest.mark.parametrize(
    ("lines", "part", "steps"), [(1, None, 0), (2, 1, 0), (4, 1, 1), (5, None, 0), (9, 2, 1)]
)
def test_look_broken_run_gives_part_and_steps(tmp_path, lines, part, steps):
    seen = look(broken(tmp_path / "j.jsonl", lines), crash.RESUME)
    assert seen is not None
    assert (seen.part, len(seen.steps)) == (part, steps)


def test_look_abort_is_recorded_and_ends_run(tmp_path):
    path = broken(tmp_path / "j.jsonl", 4)
    with pytest.raises(BrokenRunError, match="at part 1, after 1 squeeze; it is given up"):
        look(path, crash.ABORT)
    assert [entry["kind"] for entry in records(path)][-2:] == ["outcome", "end"]
    assert verify(path).closed
    assert look(path, crash.ABORT) is None


def test_look_restart_forgets_path_but_not_held_part(tmp_path):
    seen = look(broken(tmp_path / "j.jsonl", 4), crash.RESTART)
    assert seen is not None
    assert (seen.steps, seen.traversal.node) == ([], 0)
    assert seen.held_at is not None


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"table": b"another"}, "table"),
        ({"calibration_um": [[0, 1], [2, 3]]}, "calibration"),
        ({"middle_um": 1500}, "middle of the fingers"),
        ({"on_reject": "stop"}, "--on-reject"),
        ({"on_unresolved": "stop"}, "--on-unresolved"),
        ({"delivery": from_text("50,0,90").record()}, "--deliver"),
    ],
)
def test_look_resume_with_other_settings_is_refused(tmp_path, changed, what):
    path = broken(tmp_path / "j.jsonl", 4)
    with pytest.raises(BrokenRunError, match=f"had another {what}"):
        look(path, crash.RESUME, **changed)
    assert not verify(path).closed


def after_boot(wall_s: float, up_s: float = 60.0) -> dict[str, object]:
    """The present moment as seen after another boot: an uptime of `up_s`, and a date `wall_s` later."""
    return {**moment(wall_s), "boot": "another", "up_s": up_s}


TOO_OLD = {
    "too long ago": lambda: moment(400.0, 400.0),
    "too long ago, the wall clock set back": lambda: moment(-60.0, 400.0),
    "written later in this boot": lambda: moment(0.0, -600.0),
    "too long ago, another boot": lambda: after_boot(400.0),
    "another boot, the wall clock set back": lambda: after_boot(-600.0),
    "another boot, which is older than the record": lambda: after_boot(200.0, 1e6),
    "no boot": lambda: {**moment(), "boot": None},
    "no uptime": lambda: {"time": STAMP(), "boot": moment()["boot"]},
    "no date, another boot": lambda: {**after_boot(0.0), "time": "noon"},
    "no clock": dict,
}
RECENT = {
    "the wall clock set back": lambda: moment(-3600.0, 60.0),
    "the wall clock set on": lambda: moment(1e6, 60.0),
    "another boot": lambda: after_boot(120.0),
}


@pytest.mark.parametrize("policy", [crash.RESUME, crash.RESTART])
@pytest.mark.parametrize("name", TOO_OLD)
def test_look_part_of_old_or_unclear_age_is_refused(tmp_path, policy, name):
    path = broken(tmp_path / "j.jsonl", 4)
    with pytest.raises(BrokenRunError, match=r"s ago; after 300 s|is not clear"):
        look(path, policy, TOO_OLD[name]())
    assert not verify(path).closed


@pytest.mark.parametrize("name", RECENT)
def test_look_part_of_recent_age_is_resumed(tmp_path, name):
    assert look(broken(tmp_path / "j.jsonl", 4), crash.RESUME, RECENT[name]()) is not None


def test_look_between_parts_of_any_age_is_resumed(tmp_path):
    seen = look(broken(tmp_path / "j.jsonl", 5), crash.RESUME, moment(1e6, 1e6))
    assert seen is not None
    assert seen.part is None


@pytest.mark.parametrize("policy", [crash.RESUME, crash.ABORT])
def test_look_run_with_contradictory_records_is_not_resumed(tmp_path, policy):
    path = tmp_path / "j.jsonl"
    with Journal(path, STAMP) as journal:
        journal.header(TABLE, FIELDS)
        journal.record("part", {"part": 1})
        journal.record("placed", {"part": 1, "number": 1, "node": 1})
    with pytest.raises(BrokenRunError, match="the path leads to node 0"):
        look(path, policy)
    assert verify(path).closed == (policy == crash.ABORT)


def test_begin_records_resume_and_cut_bytes(tmp_path):
    path = broken(tmp_path / "j.jsonl", 4)
    with path.open("ab") as file:
        file.write(b'{"seq":4,"ti')
    with Journal(path, STAMP, SystemClock().uptime) as journal:
        seen = crash.look(journal, header(), crash.RESUME, Deaf(), 300.0)
        crash.begin(journal, seen, TABLE, FIELDS, crash.RESUME)
    last = list(records(path))[-1]
    assert (last["kind"], last["part"]) == ("resume", 1)
    assert (last["how"], last["cut_bytes"]) == ("resume", 12)
