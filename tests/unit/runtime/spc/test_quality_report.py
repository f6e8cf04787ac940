"""`grasp-audit report` turns journals into a page, a table of parts and an exit code."""

import csv
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from audited_journals import Chain, write
from histories import LESS, SHIFT_UM, TREE, drawn, expectation_document, history, table
from html_pages import Page
from programs import called
from run_logs import STAMP

from drivers.camera.commands import audit as main
from runtime.errors import JournalError
from runtime.shell.errors import UsageError
from runtime.spc import history as reading
from runtime.spc.command import COLUMNS
from runtime.spc.monitor import DRIFTED, LEAST_REFIT, MEANING, Drift, Monitor
from runtime.spc.page import page
from runtime.spc.summary import summarise
from runtime.table import dumps, load
from runtime.traversal.results import Outcome, PartResult, Step

TABLE = table()


def parts_of(count, seed=1, **drift):
    return drawn(TABLE, count, np.random.default_rng(seed), **drift)


def without_time(parts):
    return [(p.number, p.squeezes, p.outcome, p.leaf, p.verdict, p.residual) for p in parts]


def test_history_read_two_journals_returns_table_and_parts(tmp_path):
    first, second = parts_of(20), parts_of(15, seed=2, first=20)
    paths = [write(tmp_path / "a.jsonl", first), write(tmp_path / "b.jsonl", second, ended=False)]
    result = reading.read(paths)
    assert result.table == load(TREE).table
    assert without_time(result.parts) == without_time([*first, *second])
    assert {part.time for part in result.parts} == {STAMP}


def test_history_read_other_table_or_no_part_is_refused(tmp_path):
    other = replace(TABLE, tool="another")
    paths = [write(tmp_path / "a.jsonl", parts_of(2)), write(tmp_path / "b.jsonl", [], other)]
    with pytest.raises(UsageError, match="of another table"):
        reading.read(paths)
    with pytest.raises(UsageError, match="no part yet"):
        reading.read([write(tmp_path / "c.jsonl", [])])


def test_history_read_changed_journal_is_refused(tmp_path):
    path = write(tmp_path / "a.jsonl", parts_of(3))
    path.write_bytes(path.read_bytes().replace(b'"pass"', b'"fail"', 1))
    with pytest.raises(JournalError, match="changed after it was written"):
        reading.read([path])


@pytest.mark.parametrize("change", [{"node": 999}, {"node": "first"}, {"width_um": None}])
def test_history_read_squeeze_not_in_table_is_refused(tmp_path, change):
    path = tmp_path / "a.jsonl"
    with Chain(path) as journal:
        journal.header(TABLE)
        journal.record("part", {"part": 1})
        journal.record("squeeze", {"node": 0, "width_um": 30_000, "target": 1} | change)
    with pytest.raises(JournalError, match=r"a\.jsonl: has a record that does not fit its table"):
        reading.read([path])


def test_summarise_counts_match_parts():
    result = history(TABLE, parts_of(400))
    record = summarise(result)
    assert sum(record.outcomes.values()) == 400
    assert record.judged == sum(part.verdict in ("pass", "fail") for part in result.parts)
    assert record.interval[0] <= record.passed / record.judged <= record.interval[1]
    assert record.agrees
    located = [part for part in result.parts if part.leaf is not None]
    assert sum(row.parts for row in record.leaves) == len(located)
    squeezes = sum(len(part.squeezes) for part in result.parts)
    assert sum(sum(row.counts) for row in record.nodes) == squeezes
    assert record.tail > 1e-4
    for row in record.leaves:
        mine = [p.residual for p in result.parts if p.leaf == row.leaf and p.residual]
        means = [*np.mean(mine, axis=0)] if mine else []
        assert [mean for mean, _ in row.residuals] == pytest.approx(means)


def test_page_is_well_formed_and_self_contained():
    rng = np.random.default_rng(5)
    result = history(TABLE, drawn(TABLE, 60, rng), drawn(TABLE, 120, rng, width_shift_um=SHIFT_UM))
    text = page("a < b", summarise(result))
    parser = Page(text)
    assert parser.open == []
    assert {a["href"] for _, a in parser.elements if "href" in a} == {"data:,"}
    assert not [a for _, a in parser.elements if "src" in a]
    assert "http" not in text.replace("http-equiv", "")
    assert "a &lt; b" in text
    assert any(MEANING[chart].split(":")[0] in text for chart in ("widths", "branches"))
    assert "Shiryaev" not in text
    assert "nan" not in text
    assert not re.search(r"<t[dh][^>]*>-</t", text)  # an unknown value is not shown as a dash


@pytest.fixture
def journal(tmp_path):
    return write(tmp_path / "run.jsonl", parts_of(60))


def test_report_writes_page_and_csv_and_prints_json(journal, tmp_path, capsys):
    outputs = ["-o", str(tmp_path / "r.html"), "--export", str(tmp_path / "p.csv")]
    assert main(["report", str(journal), *outputs, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["parts"] == 60
    assert record["alarms"] == []
    assert (tmp_path / "r.html").read_text().startswith("<!DOCTYPE html>")
    with (tmp_path / "p.csv").open(newline="") as file:
        result = list(csv.DictReader(file))
    assert [int(row["part"]) for row in result] == list(range(60))
    assert tuple(result[0]) == COLUMNS


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["none.jsonl"], 24, "none.jsonl"),
        (["{journal}", "--export", "p.xlsx"], 2, "ends in .csv"),
        (["{journal}", "--export", "none/p.csv"], 2, "cannot be written: there is no folder none"),
        (["{journal}", "-o", "none/p.html"], 2, "cannot be written"),
    ],
)
def test_report_invalid_arguments_print_one_line(
    journal, tmp_path, monkeypatch, words, code, sentence
):
    monkeypatch.chdir(tmp_path)
    end = called(main, "report", *(word.format(journal=journal) for word in words))
    assert (end.code, end.one_line) == (code, True)
    assert sentence in end.err


def test_report_expected_flags_changed_readings(tmp_path, capsys):
    digest = hashlib.sha256(dumps(TABLE)).hexdigest()
    (tmp_path / "e.json").write_text(json.dumps(expectation_document(TABLE, digest)))
    parts = [*parts_of(60, seed=8), *parts_of(60, seed=9, first=60, shares=LESS)]
    journal = write(tmp_path / "a.jsonl", parts)
    words = ["report", str(journal), "--expected", str(tmp_path / "e.json")]
    assert main([*words, "-o", str(tmp_path / "r.html")]) == 11
    assert "readings are those of less" in capsys.readouterr().out
    assert "<h2>Readings are those of less" in (tmp_path / "r.html").read_text()


def test_report_expected_of_another_table_is_refused(journal, tmp_path, capsys):
    (tmp_path / "e.json").write_text(json.dumps(expectation_document(TABLE, "1" * 64, 10)))
    assert main(["report", str(journal), "--expected", str(tmp_path / "e.json")]) == 2
    assert "another table" in capsys.readouterr().err


def as_result(part):
    """Converts a part of a journal to the result that the run passed to its observers."""
    steps = []
    for number, squeeze in enumerate(part.squeezes, start=1):
        node = TABLE.nodes[squeeze.node]
        target = None if squeeze.branch is None else node.branches[squeeze.branch].target
        steps.append(Step(number, squeeze.node, node.squeeze, 0, squeeze.width_um, target, None))
    return PartResult.of(part.number, Outcome(part.outcome), steps, None)


@pytest.mark.parametrize("shift_um", [0.0, SHIFT_UM])
def test_drift_add_agrees_with_alarms_of_monitor_watch(shift_um):
    parts = drawn(TABLE, 120, np.random.default_rng(5), width_shift_um=shift_um)
    drift = Drift(TABLE)
    lines = [drift.add(as_result(part)) for part in parts]
    every = Monitor(TABLE).watch(history(TABLE, parts))
    alarms = [alarm.place for alarm in every if alarm.chart in DRIFTED]
    assert any(lines) == bool(alarms) == (shift_um > 0.0)
    if alarms:
        assert lines.index(True) == max(alarms[0], LEAST_REFIT - 1)
        assert all(lines[lines.index(True) :])


def test_history_read_torn_last_line_is_ignored(tmp_path):
    whole = write(tmp_path / "a.jsonl", parts_of(6), ended=False)
    result = reading.read([whole]).parts
    with whole.open("ab") as file:
        file.write(b'{"seq":99,"kind":"squ')
    assert reading.read([whole]).parts == result
    whole.write_bytes(b'{"seq":0,"kind":"hea')
    with pytest.raises(UsageError, match="no part yet"):
        reading.read([whole])
