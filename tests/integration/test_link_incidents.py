"""Incidents on the link to the gripper are in the journal of the run in which they happened."""

import pytest
from soaking import small_setting

from drivers.sim.cell import Cell
from drivers.sim.faults import Fault, Listed
from runtime import cli
from runtime.commands.journal import main as grasp_journal
from runtime.errors import JournalError
from runtime.journal.chain import MOST_INCIDENTS, Incidents, Journal, records, verify

SCALE = 20.0  # to the runtime the cell is a real one, only faster


def test_grasp_runtime_link_retries_are_journalled(tree, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    lost = [Fault("reply_lost", 0, 0), Fault("request_lost", 0, 30)]
    faults = Listed([*lost, Fault("noise", 0, 40, value=9)])
    with Cell(small_setting(), 2, SCALE, faults) as cell:
        ports = ["--port", cell.endpoints["gripper"], "--arm", cell.endpoints["arm"]]
        words = ["--tree", "small.msgpack", *ports, "--activate", "--tips", "straight"]
        words += ["--journal", "j.jsonl"]
        assert cli.main(words) in (0, 10)
    kept = list(records(tmp_path / "j.jsonl"))
    assert verify(tmp_path / "j.jsonl").closed
    assert kept[0]["kind"] == "header"
    lines = [(entry["incident"], entry["transaction"]) for entry in kept if entry["kind"] == "link"]
    assert lines[0] == ("no answer", 1)  # while connecting, before there was a journal
    assert len(lines) >= 3
    assert grasp_journal(["replay", "j.jsonl"]) == 0


def test_incidents_before_journal_are_kept_up_to_limit(tmp_path):
    incidents = Incidents()
    for number in range(MOST_INCIDENTS + 5):
        incidents.record("link", {"number": number})
    with Journal(tmp_path / "j.jsonl", lambda: "now") as journal:
        journal.header(b"table", {})
        incidents.hand_over(journal)
        incidents.record("link", {"number": -1})
    kept = records(tmp_path / "j.jsonl")
    numbers = [entry["number"] for entry in kept if entry["kind"] == "link"]
    assert numbers == [*range(MOST_INCIDENTS), -1]
    with pytest.raises((JournalError, OSError)):
        incidents.record("link", {"number": 0})
