"""The log of installed versions: one chained record for each change."""

from types import SimpleNamespace

import pytest
from sample_tables import several_table, small_table

from runtime.errors import JournalError
from runtime.journal.chain import Journal, records, verify
from runtime.journal.installed import log_of, note
from runtime.table import dumps

STAMPS = iter(f"2026-11-27T03:00:{second:02d}.000Z" for second in range(60))
SMALL, OTHER = dumps(small_table()), dumps(several_table())
FACTS = {"table": "t.msgpack", "calibration_sha256": None, "squeezetree": "0.1.0"}


def noted(journal, table=SMALL, **changed):
    runs = SimpleNamespace(path=journal, stamp=lambda: next(STAMPS), uptime=dict)
    return note(runs, table, {**FACTS, **changed})


def test_note_adds_record_only_for_a_change(tmp_path):
    journal = tmp_path / "j.jsonl"
    assert noted(journal)
    before = log_of(journal).read_bytes()
    assert not noted(journal)
    assert log_of(journal).read_bytes() == before
    assert noted(journal, OTHER)
    assert noted(journal, OTHER, calibration_sha256="ab")
    assert noted(journal, OTHER, calibration_sha256="ab", squeezetree="0.2.0")
    assert noted(journal)  # an older version that is installed again is a change too
    assert log_of(journal).read_bytes().startswith(before)
    seen = verify(log_of(journal))
    assert (seen.runs, seen.closed) == (5, True)
    headers = (entry for entry in records(log_of(journal)) if entry["kind"] == "header")
    digests = [entry["table_sha256"] for entry in headers]
    assert digests[0] == digests[4] != digests[1] == digests[2]


def test_note_changed_log_is_refused(tmp_path):
    journal = tmp_path / "j.jsonl"
    noted(journal)
    log = log_of(journal)
    log.write_bytes(log.read_bytes().replace(b"0.1.0", b"0.1.1", 1))
    with pytest.raises(JournalError, match="line 1: does not have its digest"):
        noted(journal)


def test_note_log_with_another_writer_is_refused(tmp_path):
    journal = tmp_path / "j.jsonl"
    writing = Journal(log_of(journal), lambda: "2026-11-27T03:00:00.000Z")
    with writing, pytest.raises(JournalError, match="another"):
        noted(journal)
