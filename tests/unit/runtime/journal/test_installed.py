"""The log of installed versions: one chained record for each change."""

import pytest
from sample_tables import several_table, small_table

from runtime.errors import JournalError
from runtime.journal.chain import Journal, records, verify
from runtime.journal.installed import log_of, note
from runtime.table import dumps

STAMPS = iter(f"2026-11-27T{hour:02d}:00:00.{ms:03d}Z" for hour in range(24) for ms in range(1000))
SMALL, OTHER = dumps(small_table()), dumps(several_table())
FACTS = {"table": "t.msgpack", "calibration_sha256": None, "squeezetree": "0.1.0"}


def noted(journal, table=SMALL, **changed):
    """Notes what a run uses, and records the run; returns whether the log got an entry."""
    with Journal(journal, lambda: next(STAMPS)) as runs:
        added = note(runs, table, {**FACTS, **changed})
        runs.header(table, {})
        runs.record("end", {})
    return added


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


@pytest.mark.parametrize(
    "cut",
    [
        lambda log: log.write_bytes(b""),
        lambda log: log.unlink(),
        lambda log: log.write_bytes(b"".join(log.read_bytes().splitlines(True)[:2])),
        lambda log: log.write_bytes(log.read_bytes()[:-20]),
    ],
)
def test_note_log_that_lacks_records_of_the_last_run_is_refused(tmp_path, cut):
    journal = tmp_path / "j.jsonl"
    noted(journal)
    noted(journal, OTHER)
    cut(log_of(journal))
    with pytest.raises(JournalError, match="lacks records that the last run saw"):
        noted(journal, OTHER)


def test_note_log_with_an_entry_of_a_run_that_never_began_is_continued(tmp_path):
    """A crash between the log's entry and the run's header leaves an entry that no run has seen."""
    journal = tmp_path / "j.jsonl"
    noted(journal)
    with Journal(journal, lambda: next(STAMPS)) as runs:
        note(runs, OTHER, FACTS)
    assert not noted(journal, OTHER)
