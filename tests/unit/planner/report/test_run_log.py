"""Journals that a report reads: those that the runtime writes, and damaged ones, which are refused."""

import hashlib

import pytest
from refusals import refused_in_a_line
from run_logs import chained, header, part

from planner.report import run_log
from runtime.shell.errors import InputError

TABLE = b"some table"
DIGEST = hashlib.sha256(TABLE).hexdigest()
PARTS = [
    *part(1, [(0, 132, 4), (4, 175, ~7)], "leaf", 7),
    *part(2, [(0, 10, None)], "reject", reason="width 82.4 mm fits no branch"),
    *part(3, [(0, 132, 4)], "fault", reason="the gripper does not answer"),
]


def written(tmp_path, data):
    path = tmp_path / "j.jsonl"
    path.write_bytes(data)
    return path


def test_read_journal_returns_parts_squeezes_and_outcomes(tmp_path):
    log = run_log.read(written(tmp_path, chained([header(TABLE), *PARTS])), DIGEST)
    assert [p.part for p in log.parts] == [1, 2, 3]
    assert [p.failed for p in log.parts] == [False, True, True]
    assert log.parts[0].squeezes == [(0, 132, 4), (4, 175, -8)]
    assert log.branch_counts() == {(0, 4): 2, (4, -8): 1, (0, None): 1}
    assert log.outcomes() == {"leaf": 1, "reject": 1, "fault": 1}
    assert sum(log.branch_counts().values()) == sum(len(p.squeezes) for p in log.parts)


def test_read_runs_of_other_tables_are_left_out_and_counted(tmp_path):
    data = chained([header(b"other"), *PARTS, header(TABLE), *PARTS[:4]])
    log = run_log.read(written(tmp_path, data), DIGEST)
    assert (log.runs, log.others, len(log.parts)) == (1, 1, 1)


def test_read_part_cut_short_by_a_crash_is_failed(tmp_path):
    data = chained([header(TABLE), *PARTS[:2]])
    log = run_log.read(written(tmp_path, data + b'{"seq":9,"ti'), DIGEST)
    assert log.parts[0].outcome == "cut short"
    assert log.parts[0].failed


GOOD = chained([header(TABLE), *PARTS])
LINES = GOOD.splitlines(keepends=True)
DAMAGED = {
    "empty": (b"", "is empty"),
    "no journal": (b"hello\n", "line 1 does not verify"),
    "a width changed": (GOOD.replace(b'"width_um":10,', b'"width_um":11,'), "line 7 does not"),
    "a line missing": (b"".join(LINES[:3] + LINES[4:]), "line 4 does not verify"),
    "lines exchanged": (b"".join([LINES[0], LINES[2], LINES[1]]), "line 2 does not verify"),
    "another table": (chained([header(b"other"), *PARTS]), "holds no run of this table"),
    "a field missing": (
        chained([header(TABLE), {"kind": "part", "part": 1}, {"kind": "squeeze", "part": 1}]),
        "record 3 is",
    ),
    "a squeeze of no part": (chained([header(TABLE), PARTS[1]]), "record 2 is no record"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_read_damaged_journal_is_refused_in_one_line(tmp_path, name):
    data, sentence = DAMAGED[name]
    with refused_in_a_line(InputError, sentence):
        run_log.read(written(tmp_path, data), DIGEST)
