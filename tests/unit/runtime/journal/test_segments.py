"""A journal in segments: each ends between two parts, all form one chain, a new run reads only the last."""

import os
import shutil
import signal
from collections.abc import Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path

import pytest
from sample_tables import small_table
from written_journals import write_run

from planner.report import run_log
from runtime.devices.clock import SystemClock
from runtime.errors import JournalError
from runtime.execution.crash import broken_run
from runtime.journal import chain
from runtime.journal.chain import Journal, records, verify
from runtime.journal.export import rows
from runtime.journal.files import broken_of
from runtime.journal.replay import Replay
from runtime.shell.interrupts import StopRequests, stoppable
from runtime.shell.sealed_lines import sealed_segments, segment
from runtime.spc import history
from runtime.table import dumps

STAMP = SystemClock().stamp


def write_part(journal: Journal, number: int) -> None:
    journal.record("part", {"part": number})
    journal.record("outcome", {"part": number, "outcome": "reject"})


def segmented(path: Path, *, closed: bool = True) -> Path:
    """Writes the journal of one run of three parts in three files; returns the path of the last."""
    with Journal(path, STAMP, segment_bytes=1) as journal:
        journal.header(b"table", {"port": "sim"})
        for number in (1, 2, 3):
            write_part(journal, number)
        if closed:
            journal.record("end", {"exit_code": 0})
    assert len(sealed_segments(path)) == 2
    return path


def without(entries: Iterator[dict], *names: str) -> list[dict]:
    return [{key: entry[key] for key in entry if key not in names} for entry in entries]


@pytest.fixture
def pair(tmp_path):
    """Two journals of the same two runs: one in a single file, one sealed after every part."""
    whole, cut = tmp_path / "whole.jsonl", tmp_path / "cut.jsonl"
    for path, size in ((whole, chain.SEGMENT_BYTES), (cut, 1)):
        for _ in range(2):
            write_run(path, segment_bytes=size)
    assert len(sealed_segments(whole)) == 0
    assert len(sealed_segments(cut)) == 7  # between two parts, and between the runs
    return whole, cut


def test_journal_in_segments_reads_the_same_as_in_one_file(pair):
    whole, cut = pair
    one, other = verify(whole), verify(cut)
    assert (other.runs, other.closed, other.segments) == (one.runs, one.closed, 7) == (2, True, 7)
    ours = (e for e in records(cut) if e["kind"] != "seal" and "after_part" not in e)
    varying = ("seq", "time", "up_s", "previous", "digest", "settle_s")
    assert without(ours, *varying) == without(records(whole), *varying)
    one, other = (without(rows(records(path)), "time", "settle_s") for path in pair)
    assert one == other
    parts = [history.read([path]).parts for path in pair]
    assert [part.squeezes for part in parts[0]] == [part.squeezes for part in parts[1]]
    digest = str(next(records(whole))["table_sha256"])
    logs = [run_log.read(path, digest) for path in pair]
    assert logs[0].parts == logs[1].parts
    assert (logs[1].runs, logs[1].others) == (2, 0)
    assert run_log.table_of(cut).digest == digest
    replay = Replay()
    assert list(replay.follow(records(cut))) == []
    assert (replay.decisions, replay.parts, replay.closed) == (12, 4, True)


def test_broken_run_of_last_part_equals_that_of_all_records(tmp_path):
    """Wherever a run breaks off, the records of its last part suffice to describe the break.

    The test cuts the journal after each line in turn.
    """
    for cut in count(1):
        path = tmp_path / f"{cut}.jsonl"
        write_run(path, segment_bytes=1)
        lines = path.read_bytes().splitlines(keepends=True)
        if cut > len(lines):
            break
        path.write_bytes(b"".join(lines[:cut]))
        before = [broken_run(path, records(path))]
        with Journal(path, STAMP) as journal:
            before.append(broken_run(path, journal.last_part))
        entries = [
            None if run is None else (run.parts, run.part, run.steps, run.traversal, run.last)
            for run in before
        ]
        assert entries[0] == entries[1]
    assert cut > 5


def test_journal_reads_last_segment_and_verify_reads_all(tmp_path):
    path = segmented(tmp_path / "j.jsonl")
    first = segment(path, 1)
    first.write_bytes(first.read_bytes().replace(b'"port":"sim"', b'"port":"sun"'))
    with Journal(path, STAMP) as journal:
        journal.header(b"table", {})
    with pytest.raises(JournalError, match=r"j\.jsonl\.000001, line 1: does not have its digest"):
        verify(path)


@pytest.mark.parametrize("name", ["j.jsonl", "j.jsonl.000001", "j.jsonl.000002"])
@pytest.mark.parametrize("how", ["missing", "empty", "first line missing", "last line missing"])
def test_journal_segment_with_lost_records_is_refused(tmp_path, name, how):
    path = segmented(tmp_path / "j.jsonl")
    lost = tmp_path / name
    lines = lost.read_bytes().splitlines(keepends=True)
    kept = {"empty": [], "first line missing": lines[1:], "last line missing": lines[:-1]}.get(how)
    lost.unlink() if kept is None else lost.write_bytes(b"".join(kept))
    if (name, how) != ("j.jsonl", "last line missing"):  # that one is a run that broke off
        with pytest.raises(JournalError):
            verify(path)
        # A start checks only the number of sealed segments and the seal of the last one.
        if name == "j.jsonl" or how == "missing" or (name, how[:4]) == ("j.jsonl.000002", "last"):
            with pytest.raises(JournalError):
                Journal(path, STAMP)
    assert lost.exists() == (kept is not None)


def test_journal_stop_request_while_it_rotates_raises_afterwards(tmp_path, monkeypatch):
    path, rotate = tmp_path / "j.jsonl", chain.files.rotate

    def interrupted(*words):
        os.kill(os.getpid(), signal.SIGINT)
        return rotate(*words)

    monkeypatch.setattr(chain.files, "rotate", interrupted)
    with StopRequests(), pytest.raises(KeyboardInterrupt), stoppable():
        segmented(path)
    assert (verify(path).segments, len(sealed_segments(path))) == (1, 1)


def test_journal_path_of_sealed_segment_is_refused(tmp_path):
    path = segmented(tmp_path / "j.jsonl")
    with pytest.raises(JournalError, match=r"is a segment of .*j\.jsonl; name that one"):
        Journal(segment(path, 1), STAMP)


@pytest.mark.parametrize("ending", ["000001", "7", "broken", "next"])
def test_journal_beside_another_one_whose_file_it_might_be_is_refused(tmp_path, ending):
    with Journal(tmp_path / "j.jsonl", STAMP):
        pass
    with pytest.raises(JournalError, match=r"is a segment of|may need"):
        Journal(tmp_path / f"j.jsonl.{ending}", STAMP)
    with Journal(tmp_path / "j.jsonl", STAMP):
        pass


class KilledError(BaseException):
    """Raised in place of killing the process."""


def test_journal_of_process_killed_while_sealing_stays_valid(tmp_path, monkeypatch):
    deaths = 0
    for last in count():
        path = tmp_path / f"{last}.jsonl"
        journal = Journal(path, STAMP, segment_bytes=1)
        journal.header(b"table", {})
        write_part(journal, 1)
        before = list(records(path))
        left = last

        def dying(call):
            def called(*arguments, **named):
                nonlocal left
                left -= 1
                if left < 0:
                    raise KilledError
                return call(*arguments, **named)

            return called

        with monkeypatch.context() as patched:
            for name in ("open", "write", "fsync", "rename", "fchmod"):
                patched.setattr(os, name, dying(getattr(os, name)))
            patched.setattr(os, "ftruncate", lambda *_: None)  # a killed process undoes nothing
            with suppress(KilledError):
                write_part(journal, 2)
        journal.close()
        deaths += left < 0
        with Journal(path, STAMP) as again:
            run = [entry["kind"] for entry in again.last_part]
            again.record("end", {})
        assert list(records(path))[: len(before)] == before
        assert run[0] == "header"
        assert verify(path).closed
        assert verify(path).runs == 1
        if left >= 0:
            break
    assert deaths > 10


def test_records_sealed_during_read_are_returned_once(tmp_path, monkeypatch):
    path = tmp_path / "j.jsonl"
    with Journal(path, STAMP, segment_bytes=1) as journal:
        journal.header(b"table", {})
        write_part(journal, 1)

        def sealed_meanwhile(asked):
            write_part(journal, 2)
            return sealed_segments(asked)

        with monkeypatch.context() as patched:
            patched.setattr(chain, "sealed_segments", sealed_meanwhile)
            kinds = [entry["kind"] for entry in records(path)]
    assert kinds == ["header", "part", "outcome", "seal"]


def removed(path: Path) -> None:
    path.unlink()


def renamed(path: Path) -> None:
    path.rename(path.with_name("j.jsonl.old"))


def renamed_and_created(path: Path) -> None:
    renamed(path)
    path.touch()


def copied_and_truncated(path: Path) -> None:
    shutil.copy(path, path.with_name("j.jsonl.old"))
    os.truncate(path, 0)


def cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size // 2)


def replaced(path: Path) -> None:
    copy = path.with_name("copy")
    shutil.copy(path, copy)
    copy.rename(path)


def linked(path: Path) -> None:
    renamed(path)
    path.symlink_to("j.jsonl.old")


def written_to(path: Path) -> None:
    with path.open("ab") as file:
        file.write(b"a line\n")


WHOLE = (removed, renamed, renamed_and_created, replaced, linked, written_to)
DISPLACED = (*WHOLE, copied_and_truncated, cut)


@pytest.mark.parametrize("displace", DISPLACED, ids=lambda how: how.__name__)
@pytest.mark.parametrize("begin", [write_run, segmented])
def test_journal_displaced_during_run_is_reported_and_loses_nothing(tmp_path, displace, begin):
    path = begin(tmp_path / "j.jsonl")
    with Journal(path, STAMP) as journal:
        journal.header(dumps(small_table()), {})
        journal.record("part", {"part": 1})
        whole, held = list(records(path)), path.read_bytes()
        displace(path)
        left = path.read_bytes() if path.exists() else None
        with pytest.raises(JournalError, match=r"while it was written; .* in .*j\.jsonl\.broken"):
            journal.record("placed", {"part": 1})
        journal.record("outcome", {"part": 1, "outcome": "fault"})
        journal.record("end", {"exit_code": 24})
    assert (path.read_bytes() if path.exists() else None) == left
    for refuse in (lambda: Journal(path, STAMP), lambda: verify(path)):
        with pytest.raises(JournalError, match="moved or cut beneath a run, whose records are in"):
            refuse()
    kept = broken_of(path).read_bytes()
    assert kept.startswith(held) == (displace in WHOLE)
    broken_of(path).unlink()
    path.unlink(missing_ok=True)
    path.write_bytes(kept if displace in WHOLE else held + kept)
    assert [entry["kind"] for entry in records(path)][len(whole) :] == ["outcome", "end"]
    assert verify(path).closed
    Journal(path, STAMP).close()
