"""The journal: chained, verified to the last byte, never overwritten; a full disk is an error."""

import base64
import itertools
import json
import os
import sys
from pathlib import Path

import pytest

from runtime.devices.clock import SystemClock
from runtime.errors import JournalError
from runtime.journal.chain import Journal, records, verify
from runtime.shell.sealed_lines import sealed

TABLE = b"the table's bytes"
STAMP = SystemClock().stamp
VERSION = {"journal_version": 1}


def written(path: Path, *, closed: bool = True) -> Path:
    """Writes the journal of one run: header, squeeze and, if `closed`, the end."""
    with Journal(path, STAMP) as journal:
        journal.header(TABLE, {"port": "sim"})
        journal.record("squeeze", {"part": 1, "width_um": 21_000})
        if closed:
            journal.record("end", {"exit_code": 0})
    return path


@pytest.fixture
def path(tmp_path):
    return written(tmp_path / "j.jsonl")


def test_journal_complete_run_verifies_and_returns_records_and_table(path):
    seen = verify(path)
    assert (seen.records, seen.runs, seen.closed) == (3, 1, True)
    assert base64.b64decode(next(records(path))["table_base64"]) == TABLE
    kinds = ["header", "squeeze", "end"]
    assert [(entry["seq"], entry["kind"]) for entry in records(path)] == [*enumerate(kinds)]
    assert [json.loads(line)["kind"] for line in path.read_text().splitlines()] == kinds


def test_verify_changed_byte_is_reported_in_its_line_or_next(path):
    data = path.read_bytes()
    starts = [0, *(at + 1 for at, byte in enumerate(data) if byte == ord("\n"))]
    for at in range(len(data)):
        damaged = bytearray(data)
        damaged[at] ^= 1
        path.write_bytes(damaged)
        with pytest.raises(JournalError) as refused:
            verify(path)
        line = sum(start <= at for start in starts)
        assert refused.value.line in (line, line + 1)


def test_journal_with_torn_header_starts_anew(path):
    path.write_bytes(path.read_bytes()[:100])
    with Journal(path, STAMP) as journal:
        assert (journal.cut_bytes, path.read_bytes()) == (100, b"")
        journal.header(TABLE, {})
    assert verify(path).records == 1


@pytest.mark.parametrize("call", ["write", "fsync"])
def test_record_failed_write_is_undone_and_later_ones_refused(tmp_path, monkeypatch, call):
    path = written(tmp_path / "j.jsonl", closed=False)
    whole = path.read_bytes()
    real = os.write

    def half(file, data):
        if call == "write" and len(data) < 100:
            raise OSError(28, "No space left on device")
        return real(file, data[: max(len(data) - 90, 1)])

    def fail(file):
        raise OSError(5, "Input/output error")

    with Journal(path, STAMP) as journal:
        with monkeypatch.context() as broken:
            broken.setattr(os, call, {"write": half, "fsync": fail}[call])
            with pytest.raises(JournalError, match="cannot be written"):
                journal.record("squeeze", {"part": 2, "padding": "x" * 100})
        assert path.read_bytes() == whole
        with pytest.raises(JournalError, match=r"could not be written before.*; free the disk"):
            journal.record("end", {})
    assert not verify(path).closed


def test_record_interrupted_at_any_step_leaves_valid_journal(tmp_path):
    """Ctrl-C may come between any two steps; the safe sequence still writes its records afterwards."""
    module = Journal.record.__code__.co_filename
    interrupted = 0
    for last in itertools.count():
        path = tmp_path / f"{last}.jsonl"
        with Journal(path, STAMP) as journal:
            journal.header(b"table", {})
            left = [last]

            def trace(frame, event, argument, left=left):
                if frame.f_code.co_filename != module:
                    return None
                frame.f_trace_opcodes = True
                left[0] -= 1
                if left[0] < 0:
                    sys.settrace(None)
                    raise KeyboardInterrupt
                return trace

            before = sys.gettrace()
            try:
                sys.settrace(trace)
                journal.record("squeeze", {"part": 1})
            except KeyboardInterrupt:
                interrupted += 1
            finally:
                sys.settrace(before)
            journal.record("outcome", {"part": 1})
            journal.record("end", {})
        assert verify(path).closed
        kinds = [entry["kind"] for entry in records(path)]
        assert kinds in (["header", "outcome", "end"], ["header", "squeeze", "outcome", "end"])
        if left[0] >= 0:
            break
    assert interrupted > 100


def test_journal_second_run_continues_chain(path):
    before = path.read_bytes()
    written(path, closed=False)
    assert path.read_bytes().startswith(before)
    seen = verify(path)
    assert (seen.records, seen.runs, seen.closed) == (5, 2, False)


def test_verify_record_outside_run_is_refused(path):
    with Journal(path, STAMP) as journal:
        journal.record("squeeze", {"part": 2})
    with pytest.raises(JournalError, match="line 4: does not belong to a run"):
        verify(path)


def test_journal_second_writer_is_refused(tmp_path):
    with Journal(tmp_path / "j.jsonl", STAMP), pytest.raises(JournalError, match="another process"):
        Journal(tmp_path / "j.jsonl", STAMP)


def test_journal_irregular_file_is_refused_and_unchanged(tmp_path):
    target = written(tmp_path / "j.jsonl")
    before = target.read_bytes()
    (tmp_path / "link").symlink_to(target)
    os.mkfifo(tmp_path / "fifo")
    said = {"link": "a symbolic link", "fifo": "no regular file"}
    said |= {"": "a folder", "/dev/full": "no regular"}
    for name, sentence in said.items():
        with pytest.raises(JournalError, match=f"cannot be written: it is {sentence}"):
            Journal(tmp_path / name, STAMP)
    assert target.read_bytes() == before


RECORD = b'{"seq":0,"time":"2026-11-21T00:00:00+00:00","kind":"header"'
NO_JOURNALS = [b"notes\nand more", b'{"a": 1}', b"{", b"\0" * 9, b'{"seq":1,"time":"', RECORD[:16]]
NO_JOURNALS += [RECORD + b"}\nmore", b"\n" + RECORD, RECORD + b"x" * (8 << 20)]


@pytest.mark.parametrize("content", NO_JOURNALS, ids=range(len(NO_JOURNALS)))
def test_journal_foreign_file_is_refused_and_unchanged(tmp_path, content):
    path = tmp_path / "config.json"
    path.write_bytes(content)
    with pytest.raises(JournalError):
        Journal(path, STAMP)
    assert path.read_bytes() == content


@pytest.mark.parametrize("tail", [b"notes", b'{"seq":4,"time":"', b'{"seq":3,"tome":"', b"\n{"])
def test_journal_foreign_tail_is_refused_and_unchanged(path, tail):
    path.write_bytes(content := path.read_bytes() + tail)
    for refuse in (lambda: Journal(path, STAMP), lambda: verify(path)):
        with pytest.raises(JournalError, match="line 4"):
            refuse()
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    "tail", [b"{", b'{"seq":3', b'{"seq":3,"time":"2', b'{"seq":3,\0\0\0', b"\0\0"]
)
def test_journal_torn_last_record_is_cut_off(path, tail):
    whole = path.read_bytes()
    path.write_bytes(whole + tail)
    with pytest.raises(JournalError, match="line 4: cut short"):
        verify(path)
    with Journal(path, STAMP) as journal:
        assert journal.cut_bytes == len(tail)
    assert path.read_bytes() == whole


def test_journal_missing_folder_and_empty_file_are_refused(tmp_path):
    with pytest.raises(JournalError, match="No such file or directory; make its folder"):
        Journal(tmp_path / "no folder" / "j.jsonl", STAMP)
    with pytest.raises(JournalError, match="is empty"):
        verify(Path("/dev/null"))


def test_record_reserved_names_and_nan_are_refused(tmp_path):
    with Journal(tmp_path / "j.jsonl", STAMP) as journal:
        with pytest.raises(ValueError, match="reserved field names: \\['seq'\\]"):
            journal.record("squeeze", {"seq": 1})
        with pytest.raises(ValueError, match="not JSON compliant"):
            journal.record("squeeze", {"width_mm": float("nan")})


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b"not a record at all" * 20 + b"\n", "is no record of a journal"),
        (sealed(b'{"seq":0,nonsense}')[0], "is not JSON"),
        (sealed(b'{"kind":"part"}')[0], "lacks one of"),
        (sealed(b'{"seq":0,"time":"now","kind":"part","previous":"x"}')[0], "does not follow"),
        (sealed(b'{"seq":7,"time":"now","kind":"part","previous":"x"}')[0], "has sequence"),
    ],
)
def test_verify_invalid_or_unchained_line_is_refused(tmp_path, line, message):
    """Anyone who can write the file can compute a digest; the line must also continue the chain."""
    path = tmp_path / "j.jsonl"
    path.write_bytes(line)
    with pytest.raises(JournalError, match=f"line 1: {message}"):
        verify(path)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"journal_version": 2}, "is not a header of journal version 1"),
        ({**VERSION, "table_base64": "?"}, "the embedded table is not base64"),
        (
            {**VERSION, "table_base64": "AAAA", "table_sha256": "0" * 64},
            "the embedded table is not the",
        ),
    ],
)
def test_verify_invalid_header_is_refused(tmp_path, fields, message):
    with Journal(tmp_path / "j.jsonl", STAMP) as journal:
        journal.record("header", fields)
    with pytest.raises(JournalError, match=f"line 1: {message}"):
        verify(tmp_path / "j.jsonl")
