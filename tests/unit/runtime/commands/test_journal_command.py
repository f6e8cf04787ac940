"""`grasp-journal` shows, filters, verifies, replays and exports records; damage and forgery exit with 24."""

import csv
import json

import pytest
from programs import called, document
from written_journals import ENDS, write_run

from runtime.commands.journal import main
from runtime.devices.clock import SystemClock
from runtime.journal.chain import Journal, records
from runtime.journal.lines import RESERVED


@pytest.fixture
def journal(tmp_path):
    return write_run(write_run(tmp_path / "j.jsonl"))


def lines(*words: object) -> list[str]:
    """The lines that the command prints; it must exit with 0."""
    ended = called(main, *words)
    assert ended.code == 0, ended
    return ended.out.splitlines()


def test_verify_counts_records_and_names_damaged_line(journal):
    (output,) = lines("verify", journal)
    assert "records in 2 runs verify; the last run ended" in output
    assert document(main, "verify", journal, "--json")["closed"] is True
    journal.write_bytes(journal.read_bytes().replace(b'"part":1', b'"part":3', 1))
    damaged = called(main, "verify", journal)
    assert damaged.code == 24
    assert "line 2: does not have its digest" in damaged.err
    assert called(main, "verify", "none.jsonl", "--debug").code == 24


def test_replay_derives_every_decision(journal):
    assert "12 decisions derived again, all as recorded" in lines("replay", journal)[0]
    assert document(main, "replay", journal, "--json") == {"decisions": 12, "findings": []}


def test_replay_forged_decision_with_valid_chain_exits_24(journal, tmp_path):
    forged = tmp_path / "forged.jsonl"
    with Journal(forged, SystemClock().stamp) as writing:
        for entry in records(journal):
            fields = {name: value for name, value in entry.items() if name not in RESERVED}
            if entry["kind"] == "squeeze" and entry["seq"] == 3:
                fields["target"] = 1
            writing.record(str(entry["kind"]), fields)
    lines("verify", forged)
    seen = called(main, "replay", forged)
    assert seen.code == 24
    assert seen.out.startswith("record 3: ")
    assert "records contradict those before them" in seen.err
    reported = called(main, "replay", forged, "--json")
    assert (reported.code, json.loads(reported.out)["findings"][0]["seq"]) == (24, 3)


def test_show_filters_by_part_node_outcome_and_time(journal):
    shown = lines("show", journal)
    assert len(shown) == len(list(records(journal)))
    assert "table_base64" not in "".join(shown)
    filters = [("--part", 2, "part", 2), ("--node", 1, "node", 1)]
    filters += [("--outcome", "reject", "part", 4)]
    for option, value, field, kept in filters:
        shown = lines("show", journal, option, value, "--json")
        assert {json.loads(line)[field] for line in shown} == {kept}
    assert lines("show", journal, "--since", "9999-01-01") == []


def test_show_times_adds_up_the_phases(journal):
    assert document(main, "show", journal, "--times", "--takt", "6s", "--json")["takt_s"] == 6.0
    assert "8 parts, 12 squeezes" in lines("show", journal, "--times")[0]
    assert called(main, "show", journal, "--takt", "6s").code == 2


def test_export_has_one_row_per_squeeze_with_outcome_of_part(journal, tmp_path):
    out = tmp_path / "out.csv"
    assert "12 squeezes written" in lines("export", journal, "-o", out)[0]
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["part"]) for row in rows] == [1, 2, 2, 3, 3, 4] * 2
    assert [int(row["run"]) for row in rows] == [1] * 6 + [2] * 6
    assert [row["outcome"] for row in rows[:6]] == [ENDS[int(row["part"]) - 1] for row in rows[:6]]
    squeezes = [entry for entry in records(journal) if entry["kind"] == "squeeze"]
    for row, entry in zip(rows, squeezes, strict=True):
        assert float(row["width_mm"]) == entry["width_um"] / 1000
        assert float(row["angle_rad"]) == entry["angle_urad"] / 1e6
        assert float(row["reading_mm"]) == entry["reading_um"] / 1000


def test_export_of_unfinished_part_has_empty_outcome(journal, tmp_path):
    kept = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(kept[:4]))
    out = tmp_path / "out.csv"
    lines("export", journal, "-o", out, "--json")
    with out.open() as file:
        (row,) = csv.DictReader(file)
    assert row["outcome"] == ""
