"""Replay derives a journal's claims again from its counts and reports each claim that does not follow."""

import pytest
from sample_tables import GRIPPER
from written_journals import write_run

from runtime.execution.crash import broken_run
from runtime.journal.chain import records
from runtime.journal.replay import Finding, Replay
from runtime.table import Calibration
from runtime.traversal.decision import Policy


@pytest.fixture
def journal(tmp_path):
    return write_run(tmp_path / "j.jsonl")


def findings(entries: list[dict[str, object]]) -> list[Finding]:
    return list(Replay().follow(entries))


def test_replay_unchanged_run_has_no_findings(journal):
    replay = Replay()
    assert list(replay.follow(records(journal))) == []
    assert (replay.decisions, replay.parts, replay.closed, replay.part) == (6, 4, True, None)


def test_replay_uses_calibration_of_run(tmp_path):
    same = Calibration(GRIPPER.profile, ((0, 0), (85_000, 85_000)))
    path = write_run(tmp_path / "own.jsonl", calibration=same)
    assert findings(list(records(path))) == []
    entries = list(records(path))
    entries[0]["calibration_um"] = [[0, 0], [85_000, 42_500]]
    assert len(findings(entries)) >= 6


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("squeeze", {"reading_um": 100}, "the table says None"),
        ("squeeze", {"target": 1}, "leads to 1, the table says -1"),
        ("squeeze", {"target": None}, "leads to None"),
        ("squeeze", {"width_um": 21_000}, "is 21000 um, the calibration says 20969"),
        ("squeeze", {"node": 1}, "is at node 1, the path leads to node 0"),
        ("squeeze", {"node": 17}, "is at node 17"),
        ("squeeze", {"node": None}, "is at node None"),
        ("squeeze", {"part": 9}, "is of part 9"),
        ("squeeze", {"object_flag": 1}, "cannot be followed"),
        ("squeeze", {"reading_um": 3.0}, "not an integer"),
        ("placed", {"node": 1}, "is at node 1"),
        ("outcome", {"leaf": 1}, "reports LEAF, leaf 1; the path leads to LEAF, leaf 0"),
        ("outcome", {"outcome": "unresolved"}, "reports UNRESOLVED"),
        ("outcome", {"outcome": "fault"}, "reports leaf 0 with the outcome fault"),
        ("outcome", {"outcome": "lucky"}, "unknown outcome 'lucky'"),
        ("outcome", {"exit_code": 10}, "reports exit code 10, LEAF has 0"),
    ],
)
def test_replay_changed_claim_is_reported(journal, kind, change, message):
    entries = list(records(journal))
    changed = next(entry for entry in entries if entry["kind"] == kind)
    changed.update(change)
    result = findings(entries)
    assert result
    assert result[0].seq == changed["seq"]
    assert message in result[0].sentence


def test_broken_run_lacking_only_end_record_is_none(tmp_path):
    path = write_run(tmp_path / "stop.jsonl", Policy.of("stop", "next"))
    entries = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(entries[:-1]))
    assert broken_run(path, records(path)) is None
