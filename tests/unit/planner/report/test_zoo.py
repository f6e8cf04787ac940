"""The zoo of outlines: a row of figures for each outline, and a page of all outlines."""

import math

import pytest
from problems import regular_polygon
from programs import TREES

from planner.diagnosis import reasons
from planner.job import model as job_file
from planner.report import zoo

BASE = job_file.load(TREES / "ratchet" / "job.toml")
WIDE = [[0, 0], [84, 0], [84, 20], [40, 20]]


def item(outline, name="a <part>", **changes):
    return zoo.Item(name, outline, BASE.replaced(**changes).canonical(), math.inf)


def test_judge_part_beyond_the_opening_is_too_large():
    row = zoo.judge(item(WIDE))
    assert row["kind"] == reasons.TOO_LARGE
    assert "seconds" in row


@pytest.mark.parametrize("outlines", [0, 1])
def test_page_without_located_outlines_states_no_figures_of_them(outlines):
    rows = [zoo.judge(item(WIDE))] * outlines
    text = zoo.page(rows)
    assert "0 are located" in text
    assert "nan" not in text
    assert "located parts take" not in text


def test_judge_error_of_the_program_is_returned_as_a_row(monkeypatch):
    monkeypatch.setattr(zoo, "compile_job", lambda *_, **__: 1 / 0)
    row = zoo.judge(item([[0, 0], [30, 0], [0, 20]]))
    assert (row["kind"], row["text"]) == (zoo.ERROR, "ZeroDivisionError: division by zero")


@pytest.mark.slow
def test_judge_hexagon_is_located_and_page_lists_all_outlines():
    few = {"particles": 1000}
    row = zoo.judge(item(regular_polygon(6, 14.0).tolist(), search=few))
    assert row["kind"] is None
    assert row["success_rate"] >= zoo.LOCATED
    assert row["symmetry"] == 6
    text = zoo.page([row, zoo.judge(item(WIDE))])
    assert text.count("<polygon") == 2
    assert "a &lt;part&gt;" in text
    assert "1 are located" in text
    assert f'<th scope="row">{reasons.TOO_LARGE}</th><td>1</td>' in text
