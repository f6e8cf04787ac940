"""The page of a table: whole, self-contained, the same each time, and true to the table."""

import hashlib
import json
import re
from pathlib import Path

import pytest
from grown_tables import grown_table
from html_pages import Page
from run_logs import chained, header, part

from planner.cli import report
from planner.evaluation.cases import assumption_cases
from planner.job import model as job_file
from planner.report import dossier, run_log
from planner.report.run_log import RunLog
from runtime.table import PPM, decision_map, dumps, load, wilson_interval

TABLE_PATH = Path(__file__).parents[4] / "trees" / "rectangle" / "rectangle.msgpack"
TABLE = load(TABLE_PATH).table
JOB = job_file.from_canonical(TABLE.job)
TRIALS = 300


@pytest.fixture(scope="module")
def text():
    return dossier.page(TABLE, JOB, dossier.Source("rectangle.msgpack", dumps(TABLE)), TRIALS)


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


@pytest.fixture(scope="module")
def data(page):
    return json.loads(page.scripts["data"])


def test_every_tag_is_closed_and_every_id_is_used_once(page):
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_nothing_comes_from_elsewhere(page, text):
    for _, attributes in page.elements:
        for name in ("src", "href", "xlink:href", "action", "srcset"):
            assert attributes.get(name, "#").startswith(("#", "data:,"))
    assert re.findall(r"@import|url\(|https?://(?!www\.w3\.org/2000/svg)", text) == []
    assert "default-src 'none'" in text


def test_links_lead_to_ids_of_the_page(page):
    ids = {attributes.get("id") for _, attributes in page.elements}
    links = {attributes["href"][1:] for tag, attributes in page.elements if tag in ("a", "use")}
    assert links <= ids
    assert len(links) > len(TABLE.leaves)


def test_each_node_and_leaf_has_a_panel_with_a_name_and_exactly_one_is_in_the_tab_order(page):
    panels = [a for _, a in page.elements if a.get("class", "").startswith("panel")]
    assert len(panels) == len(TABLE.nodes) + len(TABLE.leaves)
    assert all(panel["aria-label"] and panel["role"] == "button" for panel in panels)
    assert [panel["tabindex"] for panel in panels].count("0") == 1


def test_the_same_table_gives_the_same_bytes(text):
    assert text == dossier.page(
        TABLE, JOB, dossier.Source("rectangle.msgpack", dumps(TABLE)), TRIALS
    )


def test_the_summary_is_the_tables_own(text):
    trials = TABLE.predicted.trials
    low, high = wilson_interval(round(TABLE.predicted.success_ppm * trials / PPM), trials)
    assert f"{TABLE.predicted.success_ppm / PPM:.2%}".replace("%", " %") in text
    assert f"{100 * low:.2f} % to {100 * high:.2f} %" in text
    assert TABLE.job_digest.hex() in text
    assert hashlib.sha256(dumps(TABLE)).hexdigest() in text


def test_a_bound_stands_beside_the_squeezes_where_one_was_asked_for(tmp_path, text, capsys):
    words = [str(TABLE_PATH), "-o", str(tmp_path / "page.html"), "--trials", "100"]
    assert report.main([*words, "--bound", "1000"]) == 0
    capsys.readouterr()
    page = (tmp_path / "page.html").read_text()
    assert Page(page).open == []
    least = re.search(r"any plan as good: (\d\.\d\d) or more", page)[1]
    assert 2.0 < float(least) < TABLE.predicted.mean_squeezes_ppm / PPM
    assert f"takes {least} squeezes a part or more" in page
    assert "as good" not in text


def test_a_second_world_is_one_more_row(tmp_path, text, capsys):
    words = [str(TABLE_PATH), "-o", str(tmp_path / "page.html"), "--trials", "50"]
    assert report.main([*words, "--world", "planner.world:make"]) == 0
    page = (tmp_path / "page.html").read_text()
    assert '<th scope="row">planner.world:make, 50 parts</th>' in page
    assert page.count('<th scope="row">') == text.count('<th scope="row">') + 1
    assert report.main([*words, "--world", "nothing:there"]) == 2
    assert "--world nothing:there" in capsys.readouterr().err


def test_parts_are_neither_lost_nor_made(data):
    assert data["nodes"][0]["visits"] == TRIALS
    arrivals = {0: TRIALS}
    for index, node in enumerate(data["nodes"]):
        assert node["visits"] == arrivals[index]
        assert sum(branch[5] for branch in node["branches"]) + node["rejected"] == node["visits"]
        assert sum(number for _, number in node["seen"]) == node["visits"]
        arrivals |= {branch[4]: branch[5] for branch in node["branches"]}
    assert [leaf["visits"] for leaf in data["leaves"]] == [
        arrivals[~k] for k in range(len(data["leaves"]))
    ]


def test_widths_and_branches_are_those_of_the_look_up(data):
    for node, shown in zip(TABLE.nodes, data["nodes"], strict=True):
        meant = decision_map(node, TABLE.gripper).either
        assert [tuple(run) for run in shown["map"]] == meant.intervals()
        assert sum(times for _, times in shown["seen"]) == shown["visits"]


def test_each_other_world_differs_from_the_job_and_is_a_job():
    cases = assumption_cases(JOB)
    assert (
        len({case.name for case in cases}) == len({case.job(JOB) for case in cases}) == len(cases)
    )
    assert cases[0].job(JOB) == JOB


def test_a_name_cannot_break_out_of_the_page(text):
    evil = '</script><img src=x onerror="alert(1)">'
    spoilt = job_file.from_canonical(TABLE.job.replace('"rectangle"', json.dumps(evil)))
    log = RunLog([run_log.PartLog(1, reason=evil)], 1, 0, "", "")
    page = Page(dossier.page(TABLE, spoilt, dossier.Source(evil, b"", log), 50))
    assert not [tag for tag, _ in page.elements if tag == "img"]
    assert json.loads(page.scripts["data"])["log"]["parts"][0][3] == evil
    assert len([tag for tag, _ in page.elements if tag == "script"]) == 2


def test_a_large_table_stays_under_three_megabytes():
    table = grown_table(5, 800)
    text = dossier.page(table, JOB, dossier.Source("large.msgpack", b""), 200)
    assert len(text.encode()) < 3_000_000


def journal_of(tmp_path):
    node = TABLE.nodes[0]
    target = node.branches[0].target
    steps = [(0, 132, target)]
    entries = [
        header(dumps(TABLE)),
        *part(1, steps, "fault", reason="no answer"),
        *part(2, [], "stopped"),
    ]
    path = tmp_path / "j.jsonl"
    path.write_bytes(chained(entries))
    return path, target


def test_a_journal_is_laid_over_the_tree(tmp_path, capsys):
    journal, target = journal_of(tmp_path)
    output = tmp_path / "page.html"
    words = [
        str(TABLE_PATH),
        "-o",
        str(output),
        "--journal",
        str(journal),
        "--trials",
        "100",
        "--json",
    ]
    assert report.main(words) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["bytes"] == output.stat().st_size
    assert (record["nodes"], record["leaves"]) == (len(TABLE.nodes), len(TABLE.leaves))
    log = json.loads(Page(output.read_text()).scripts["data"])["log"]
    assert log["branches"] == [[0, target, 1]]
    assert log["parts"][0] == [1, "fault", None, "no answer", None, [[0, 132, target]]]


def test_takt_stands_on_the_page_as_forecast_and_as_measured(tmp_path, text):
    assert "Done within" not in text
    output, journal = tmp_path / "page.html", tmp_path / "j.jsonl"
    entries = [header(dumps(TABLE)), *part(1, [], "stopped"), *part(2, [], "stopped")]
    entries[2]["seconds"], entries[4]["seconds"] = 5.0, 601.0
    journal.write_bytes(chained(entries))
    words = [str(TABLE_PATH), "-o", str(output), "--trials", "100", "--takt", "600s"]
    assert report.main(words) == 0
    card = output.read_text().partition("<dt>Done within 600 s</dt>")[2].partition("</div>")[0]
    assert "<dd>100.00 %</dd>" in card
    assert "measured" not in card
    assert report.main([*words, "--journal", str(journal)]) == 0
    card = output.read_text().partition("<dt>Done within 600 s</dt>")[2].partition("</div>")[0]
    assert "<dd>100.00 %</dd>" in card
    assert "measured 50.00 % of 2" in card


def test_all_failed_parts_are_listed_before_others(monkeypatch):
    monkeypatch.setattr(dossier, "LISTED", 3)
    outcomes = ["reject", "leaf", "leaf", "fault", "leaf"]
    log = RunLog(
        [run_log.PartLog(k, outcome=outcome) for k, outcome in enumerate(outcomes)], 1, 0, "", ""
    )
    source = dossier.Source("t", b"", log)
    listed = json.loads(Page(dossier.page(TABLE, JOB, source, 50)).scripts["data"])["log"]["parts"]
    assert [entry[0] for entry in listed] == [0, 3, 4]


def test_wrong_input_is_one_line(tmp_path, capsys):
    cases = [
        (3, [str(tmp_path / "none.msgpack"), "-o", str(tmp_path / "p.html")]),
        (2, [str(TABLE_PATH), "-o", str(tmp_path / "none" / "p.html")]),
        (
            3,
            [
                str(TABLE_PATH),
                "-o",
                str(tmp_path / "p.html"),
                "--journal",
                str(tmp_path / "none.jsonl"),
            ],
        ),
        (2, [str(TABLE_PATH), "-o", str(tmp_path / "p.html"), "--trials", "99999999"]),
    ]
    for code, words in cases:
        assert report.main(words) == code
        assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
