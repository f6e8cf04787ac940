"""Journals that are read together: none may count twice."""

import shutil

import pytest
from run_logs import chained

from runtime.shell.errors import UsageError
from runtime.shell.sealed_lines import check_distinct, segment


@pytest.fixture
def journals(tmp_path):
    """Paths of two journals; the first one has a sealed segment."""
    one, two = tmp_path / "one.jsonl", tmp_path / "two.jsonl"
    segment(one, 1).write_bytes(chained([{"kind": "header", "seed": 1}, {"kind": "seal"}]))
    one.write_bytes(chained([{"kind": "header", "seed": 1, "after_part": 7}]))
    two.write_bytes(chained([{"kind": "header", "seed": 2}]))
    return one, two


def test_check_distinct_other_runs_and_missing_files_pass(journals, tmp_path):
    check_distinct([*journals, tmp_path / "missing.jsonl"])


@pytest.mark.parametrize("repeat", ["same", "copy", "segment", "linked"])
def test_check_distinct_journal_that_counts_twice_raises(journals, tmp_path, repeat):
    one, two = journals
    again = {"same": one, "segment": segment(one, 1)}.get(repeat, tmp_path / "again.jsonl")
    if repeat == "copy":
        shutil.copy(one, again)
    elif repeat == "linked":
        again.symlink_to(one)
    with pytest.raises(UsageError, match=r"name each journal once"):
        check_distinct([one, two, again])
