"""`grasp-journal`: records shown, filtered, verified, replayed, exported; damage and forgery are 24."""

import csv
import json

import pytest
from written_journals import ENDS, write_run

from runtime.commands.journal import main
from runtime.devices.clock import SystemClock
from runtime.journal.chain import Journal, records
from runtime.journal.lines import RESERVED


@pytest.fixture
def journal(tmp_path):
    return write_run(write_run(tmp_path / "j.jsonl"))


def lines(capsys: pytest.CaptureFixture[str]) -> list[str]:
    return capsys.readouterr().out.splitlines()


def test_verify_counts_and_names_the_damaged_line(journal, capsys):
    assert main(["verify", str(journal)]) == 0
    (output,) = lines(capsys)
    assert "records in 2 runs verify; the last run ended" in output
    assert main(["verify", str(journal), "--json"]) == 0
    assert json.loads(lines(capsys)[0])["closed"] is True
    journal.write_bytes(journal.read_bytes().replace(b'"part":1', b'"part":3', 1))
    assert main(["verify", str(journal)]) == 24
    assert "line 2: does not have its digest" in capsys.readouterr().err
    assert main(["verify", "none.jsonl", "--debug"]) == 24


def test_replay_derives_every_decision(journal, capsys):
    assert main(["replay", str(journal)]) == 0
    assert "12 decisions derived again, all as recorded" in lines(capsys)[0]
    assert main(["replay", str(journal), "--json"]) == 0
    assert json.loads(lines(capsys)[0]) == {"decisions": 12, "findings": []}


def test_a_forged_decision_is_24_though_its_chain_holds(journal, tmp_path, capsys):
    forged = tmp_path / "forged.jsonl"
    with Journal(forged, SystemClock().stamp) as writing:
        for entry in records(journal):
            fields = {name: value for name, value in entry.items() if name not in RESERVED}
            if entry["kind"] == "squeeze" and entry["seq"] == 3:
                fields["target"] = 1
            writing.record(str(entry["kind"]), fields)
    assert main(["verify", str(forged)]) == 0
    capsys.readouterr()
    assert main(["replay", str(forged)]) == 24
    seen = capsys.readouterr()
    assert seen.out.startswith("record 3: ")
    assert "records claim what their counts do not justify" in seen.err
    assert main(["replay", str(forged), "--json"]) == 24
    assert json.loads(lines(capsys)[0])["findings"][0]["seq"] == 3


def test_show_filters_by_part_node_outcome_and_time(journal, capsys):
    assert main(["show", str(journal)]) == 0
    shown = lines(capsys)
    assert len(shown) == len(list(records(journal)))
    assert "table_base64" not in "".join(shown)
    assert main(["show", str(journal), "--part", "2", "--json"]) == 0
    assert {json.loads(line)["part"] for line in lines(capsys)} == {2}
    assert main(["show", str(journal), "--node", "1", "--json"]) == 0
    assert {json.loads(line)["node"] for line in lines(capsys)} == {1}
    assert main(["show", str(journal), "--outcome", "reject", "--json"]) == 0
    assert {json.loads(line)["part"] for line in lines(capsys)} == {4}
    assert main(["show", str(journal), "--since", "9999-01-01"]) == 0
    assert lines(capsys) == []


def test_show_times_adds_up_the_phases(journal, capsys):
    assert main(["show", str(journal), "--times", "--takt", "6s", "--json"]) == 0
    assert json.loads(lines(capsys)[0])["takt_s"] == 6.0
    assert main(["show", str(journal), "--times"]) == 0
    assert "8 parts, 12 squeezes" in lines(capsys)[0]
    assert main(["show", str(journal), "--takt", "6s"]) == 2


def test_csv_has_one_row_a_squeeze_with_its_parts_end(journal, tmp_path, capsys):
    out = tmp_path / "out.csv"
    assert main(["export", str(journal), "-o", str(out)]) == 0
    assert "12 squeezes written" in lines(capsys)[0]
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


def test_a_part_that_broke_off_is_exported_without_an_end(journal, tmp_path):
    kept = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(kept[:4]))
    out = tmp_path / "out.csv"
    assert main(["export", str(journal), "-o", str(out), "--json"]) == 0
    with out.open() as file:
        (row,) = csv.DictReader(file)
    assert row["outcome"] == ""
