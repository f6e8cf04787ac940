"""The figures of a shift: yield, lost parts, and the counts that begin anew at a change of shift."""

import json
import time
from dataclasses import replace
from datetime import UTC, datetime

import pytest
from sample_tables import small_table
from written_journals import write_run

from runtime.commands.arguments import parser
from runtime.devices.clock import SystemClock
from runtime.monitoring.shift import Shift
from runtime.traversal.results import Outcome, PartResult, Step

NODES = small_table().nodes
FIRST = Step(1, 0, NODES[0].squeeze, 174, 20_969, ~0, None)
SECOND = Step(2, 1, NODES[1].squeeze, 180, 18_500, None, "no such width")
GOOD = replace(PartResult.of(1, Outcome.LEAF, [FIRST], None), seconds=5.0)


class Clock(SystemClock):
    """A clock whose hour a test sets."""

    hour = 13

    def local(self):
        return f"2026-11-27 {Clock.hour:02}:30"

    def shift(self, changes):
        return f"2026-11-27 {max(hour for hour in changes if hour <= Clock.hour):02}:00"


@pytest.fixture
def shift():
    Clock.hour = 13
    return Shift((6, 14, 22), 6.0, Clock())


def test_shift_counts_yield_and_takt(shift):
    for result in (GOOD, GOOD, replace(GOOD, seconds=9.0), replace(GOOD, audit="fail")):
        shift.add(result)
    seen = shift.as_object()
    assert (seen["since"], seen["parts"], seen["good"]) == ("2026-11-27 13:30", 4, 3)
    assert (seen["seconds_mean"], seen["takt_s"], seen["takt_share"]) == (6.0, 6.0, 0.75)


def test_shift_change_resets_counts(shift):
    shift.add(GOOD)
    Clock.hour = 14
    seen = shift.as_object()
    assert (seen["since"], seen["parts"], seen["seconds_mean"]) == ("2026-11-27 14:00", 0, None)


@pytest.mark.parametrize(
    ("utc", "began"),
    [
        ((2026, 3, 29, 22, 30), "2026-03-29 22:00"),  # 00:30 after the day of 23 hours
        ((2026, 10, 25, 22, 30), "2026-10-25 22:00"),  # 23:30 on the day of 25 hours
        ((2026, 10, 26, 0, 30), "2026-10-25 22:00"),
    ],
)
def test_system_clock_shift_at_change_of_summer_time_began_on_calendar_day(
    utc, began, central_europe, monkeypatch
):
    monkeypatch.setattr(time, "time", datetime(*utc, tzinfo=UTC).timestamp)
    assert SystemClock().shift((6, 14, 22)) == began


@pytest.fixture
def central_europe(monkeypatch):
    with monkeypatch.context() as zone:
        zone.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        time.tzset()
        yield
    time.tzset()


def test_shift_losses_are_grouped_and_sorted_by_frequency(shift):
    shift.add(replace(GOOD, delivery="missed", reason="no way"))
    for part in (7, 8):
        shift.add(PartResult.of(part, Outcome.REJECT, [FIRST, SECOND], "no such width"))
    shift.add(PartResult.of(9, Outcome.FAULT, [], "no answer"))
    losses = shift.as_object()["losses"]
    counted = [(loss["kind"], loss["squeeze"], loss["parts"]) for loss in losses]
    assert counted == [("reject", 2, 2), ("delivery", 1, 1), ("fault", 0, 1)]
    assert (losses[0]["part"], losses[0]["node"], losses[0]["width_mm"]) == (8, 1, 18.5)
    assert losses[2]["node"] is None


def test_recall_journal_of_same_table_adds_its_parts(tmp_path):
    """The journal of `write_run` has four parts: two leaves, an unresolved leaf and a reject."""
    journal = write_run(tmp_path / "j.jsonl")
    digest = json.loads(journal.read_text().splitlines()[0])["table_sha256"]
    shift = Shift(range(24), None)
    shift.recall(journal, "another table")
    shift.recall(tmp_path / "none.jsonl", digest)
    assert shift.as_object()["parts"] == 0
    with journal.open("a") as file:
        file.write("cut sho")
    shift.recall(journal, digest)
    seen = shift.as_object()
    assert (seen["parts"], seen["good"]) == (4, 2)
    assert {loss["kind"] for loss in seen["losses"]} == {"unresolved", "reject"}


HEADER = '{"kind":"header","table_sha256":"x"}\n'
ENDED = '{"kind":"outcome","time":"9999-01-01"}\n'


NO_JOURNALS = ["[1]\n", f'{HEADER}{{"kind":"outcome"}}\n', HEADER + ENDED]
NO_JOURNALS.append(HEADER + ENDED.replace("9999", "now"))


@pytest.mark.parametrize("text", NO_JOURNALS)
def test_recall_invalid_journal_adds_nothing(text, shift, tmp_path):
    (tmp_path / "j.jsonl").write_text(text)
    shift.recall(tmp_path / "j.jsonl", "x")
    assert shift.as_object()["parts"] == 0


@pytest.mark.parametrize("text", ["", "24", "6,,14", "-1", "6;14", "six"])
def test_shifts_option_invalid_hours_are_refused(text, capsys):
    with pytest.raises(SystemExit):
        parser().parse_args(["--tree", "t", f"--shifts={text}"])
    assert "write hours from 0 to 23" in capsys.readouterr().err
