"""The page of a table: well-formed, self-contained, and true to the table and its journal."""

import json
import re

import pytest
from browser import LEGIBLE, NEEDED, played
from html_pages import Page
from programs import called, document
from rectangle import TABLE_PATH
from run_logs import chained, header, part

from planner.cli import report
from planner.job import model as job_file
from planner.report import dossier, run_log
from planner.report.branches import tree_of
from planner.report.replay import replay
from planner.report.run_log import RunLog
from planner.report.tree import key_of
from runtime.table import dumps, load

TABLE = load(TABLE_PATH).table
JOB = job_file.from_canonical(TABLE.job)
TRIALS = 300


@pytest.fixture(scope="module")
def text():
    return dossier.page(TABLE, JOB, dossier.Source("rectangle.msgpack", dumps(TABLE)), TRIALS)


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_page_closes_all_tags_and_uses_each_id_once(page):
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))


def test_page_loads_nothing_from_elsewhere(page, text):
    for _, attributes in page.elements:
        for name in ("src", "href", "xlink:href", "action", "srcset"):
            assert attributes.get(name, "#").startswith(("#", "data:,"))
    assert re.findall(r"@import|url\(|https?://(?!www\.w3\.org/2000/svg)", text) == []
    assert "default-src 'none'" in text


def test_tree_of_places_conserves_the_parts():
    beliefs = replay(TABLE, JOB, TRIALS, 0)
    places = {place.panel.key: place for place in tree_of(TABLE, JOB, beliefs, None).places}
    assert len(places) == len(TABLE.nodes) + len(TABLE.leaves)
    arrivals = {"node-0": TRIALS}
    for place in places.values():
        arrivals |= {way.key: way.parts for way in place.ways}
    for key, place in places.items():
        assert place.facts["parts here"].startswith(f"{arrivals[key]} of {TRIALS}")
        if place.ways:
            rejected = int(place.facts["rejected here"])
            assert sum(way.parts for way in place.ways) + rejected == arrivals[key]


def test_page_hostile_name_stays_text(text):
    evil = '</script><img src=x onerror="alert(1)">'
    spoilt = job_file.from_canonical(TABLE.job.replace('"rectangle"', json.dumps(evil)))
    log = RunLog([run_log.PartLog(1, reason=evil)], 1, 0, "", "")
    page = Page(dossier.page(TABLE, spoilt, dossier.Source(evil, b"", log), 50))
    assert not [tag for tag, _ in page.elements if tag == "img"]
    assert json.loads(page.scripts["data"])["parts"][0]["reason"] == evil
    assert len([tag for tag, _ in page.elements if tag == "script"]) == 2


def journal_of(tmp_path):
    """Writes a journal whose first part faults after a squeeze; returns path and that squeeze's target."""
    target = TABLE.nodes[0].branches[0].target
    parts = [*part(1, [(0, 132, target)], "fault", reason="no answer"), *part(2, [], "stopped")]
    path = tmp_path / "j.jsonl"
    path.write_bytes(chained([header(dumps(TABLE)), *parts]))
    return path, target


def words_of(output):
    return [str(TABLE_PATH), "-o", str(output), "--trials", "50"]


def test_report_journal_is_laid_over_the_tree(tmp_path):
    journal, target = journal_of(tmp_path)
    output = tmp_path / "page.html"
    record = document(report.main, *words_of(output), "--journal", journal, "--json")
    assert record["bytes"] == output.stat().st_size
    assert (record["nodes"], record["leaves"]) == (len(TABLE.nodes), len(TABLE.leaves))
    text = output.read_text()
    first = json.loads(Page(text).scripts["data"])["parts"][0]
    assert (first["part"], first["outcome"], first["reason"]) == (1, "fault", "no answer")
    assert first["failed"]
    assert [(s["node"], s["to"]) for s in first["squeezes"]] == [("node-0", key_of(target))]
    assert ", 1\u00d7</small>" in text  # the number of parts on this branch
    assert "rejects" not in text.split("</style>")[1].split("<script")[0]


def test_report_rejects_of_a_journal_are_drawn_with_the_part(tmp_path):
    journal, output = tmp_path / "j.jsonl", tmp_path / "page.html"
    parts = [entry for k in range(1, 11) for entry in part(k, [(0, 20, None)], "reject")]
    journal.write_bytes(chained([header(dumps(TABLE)), *parts]))
    assert report.main([*words_of(output), "--journal", str(journal)]) == 0
    figures = output.read_text().partition('id="rejects"')[2].partition("</section>")[0]
    assert figures.count("<figure>") == figures.count('class="part"') == 10
    assert figures.count('class="finger"') == 20
    assert "planned: another part?" in figures
    assert "2 more" in figures


def test_report_compare_shows_two_plans_or_two_runs(tmp_path):
    journal, _ = journal_of(tmp_path)
    output = tmp_path / "page.html"
    words = [*words_of(output), "--compare"]
    assert report.main([*words, str(TABLE_PATH)]) == 0
    rows = output.read_text().partition("<h2>Compared</h2>")[2].partition("</table>")[0]
    cells = re.findall(r"<td>([^<]*)</td><td>([^<]*)</td>", rows)
    assert len(cells) > 5
    assert all(this == other for this, other in cells)
    assert report.main([*words, str(journal), "--journal", str(journal)]) == 0
    assert "ended as fault" in output.read_text()
    ended = called(report.main, *words, journal)
    assert (ended.code, ended.one_line) == (3, True)


@NEEDED
def test_page_way_is_chosen_by_click_keys_widths_and_journal(tmp_path):
    branch = max(TABLE.nodes[0].branches, key=lambda branch: branch.probability_ppm)
    key, width = key_of(branch.target), branch.expected_um / 1e3
    squeezes = [run_log.Squeezed(0, 132, branch.target)]
    log = RunLog([run_log.PartLog(7, squeezes, "fault", reason="no answer")], 1, 0, "", "")
    text = dossier.page(TABLE, JOB, dossier.Source("t", b"", log), 100)
    script = f"""
    const title = () => byId("details").querySelector("h3").textContent, seen = {{}};
    seen.first = title();
    byId("node-0").click();
    press("ArrowRight");
    seen.keys = page.activeElement.id;
    press("ArrowLeft");
    seen.back = page.activeElement.id;
    choose("goto", "{width:.1f}");
    seen.widths = page.activeElement.id;
    choose("goto", "0.1");
    seen.refused = byId("said").textContent;
    byId("log-next").click();
    seen.step = byId("log-step").textContent;
    seen.marks = page.querySelectorAll("#details .mark").length;
    seen.taken = [...page.querySelectorAll(".panel.taken")].map(panel => panel.id);
    seen.end = byId("log-next").disabled;
    byId("details").querySelector("table [data-to]").click();
    seen.link = title();
    return seen;
    """
    seen = played(text, script, tmp_path)
    assert seen["first"] == "Node 0"
    assert re.fullmatch(r"(node|leaf)-\d+", seen["keys"])
    assert (seen["back"], seen["widths"]) == ("node-0", key)
    assert seen["refused"] == "node 0 rejects 0.1 mm"
    assert seen["step"].startswith("Part 7, squeeze 1: node 0 read ")
    assert seen["step"].endswith("Outcome: fault: no answer.")
    assert (seen["marks"], seen["end"]) == (1, True)
    assert seen["taken"] == ["node-0", key]
    assert seen["link"].endswith(" after node 0")


@NEEDED
@pytest.mark.parametrize("width", [1400, 390])
def test_page_on_a_wide_or_narrow_screen_is_legible(text, tmp_path, width):
    assert played(text, LEGIBLE, tmp_path, width) == {"small": [], "over": 0}
