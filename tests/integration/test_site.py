"""The site is built with warnings as errors, its links resolve, and it loads nothing external."""

import json
import os
import re
import sys
from html import unescape

import pytest
from documents import COMMANDS, DOCS
from launch import RESULTS
from programs import ROOT, ended, module_at

SITE = DOCS / "site"
kept, links = (module_at(SITE / name) for name in ("kept.py", "links.py"))


# Notebooks are run by test_python_page.py, in one process and not as three kernels.
BUILD = (
    "import build; build.STRICT += ['-D', 'nb_execution_mode=off']; raise SystemExit(build.main())"
)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    output = tmp_path_factory.mktemp("site") / "built"
    words = [sys.executable, "-c", BUILD, "-o", output]
    code, out, err = ended(words, env={**os.environ, "PYTHONPATH": str(SITE)}, timeout=240)
    assert (code, err) == (0, "")
    assert "not fetched" in out
    return output


def words_of(text):
    """The letters and digits of a text, which Markdown and HTML leave unchanged."""
    return re.sub(r"\W", "", text)


def text_of(page):
    """The visible text of a page."""
    return unescape(re.sub(r"<[^>]+>", "", page.read_text()))


def test_site_start_page_is_readme(site):
    start = site / re.search(r"url=(\S+)\"", (site / "index.html").read_text())[1]
    assert "A parallel-jaw gripper locates a planar part" in text_of(start)


SOURCES = [
    *("README.md", "CHANGELOG.md", "runtime/table/TABLE.md", "runtime/OUTCOMES.md"),
    *("drivers/sim/FAULTS.md", "drivers/abb/README.md", "drivers/camera/README.md"),
    "drivers/dh/README.md",
    *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "tools").glob("d*s/[!T]*.md"))),
]


def test_site_has_page_with_title_of_each_document(site):
    for source in SOURCES:
        page = (site / source).with_suffix(".html").read_text()
        title = re.search(r"^# (.+)$", (ROOT / source).read_text(), re.MULTILINE)[1]
        shown = re.search(r"<h1>(.*?)<a class=", page, re.DOTALL)[1]
        shown = unescape(re.sub(r"<[^>]+>", "", shown))
        assert words_of(title.replace("`", "")) == words_of(shown), source


def test_site_links_resolve_and_pages_load_nothing_external(site):
    result = links.check(site)
    assert result.faults == []
    assert all(address.startswith("https://") for address in result.outside)


def test_site_formulas_are_drawn(site):
    page = (site / "tools/docs/how-it-works.html").read_text()
    drawn = re.findall(r'<svg role="img" aria-label="([^"]*)"', page)
    text = (DOCS / "how-it-works.md").read_text()
    written = re.findall(r"\$\$.*?\$\$|\$[^$\n]+\$", text, re.DOTALL)
    assert len(drawn) == len(written) >= 30
    heights = [float(em) for em in re.findall(r'<svg role="img"[^>]* height="([\d.]+)em"', page)]
    assert len(heights) == len(drawn)
    assert max(heights) < 6.0  # a bracket that grew without bounds would show here
    assert "\\mathbf" not in text_of(site / "tools/docs/how-it-works.html")


def test_site_scrolling_elements_are_focusable_and_images_labelled(site):
    for page in site.rglob("*.html"):
        text = page.read_text()
        for tag in re.findall(r"<pre[^>]*>|<div[^>]*table-wrapper[^>]*>|<p[^>]*>(?=<img)", text):
            assert 'tabindex="0"' in tag, f"{page.name}: {tag}"
        assert all("aria-level" in tag for tag in re.findall(r'<[^>]*role="heading"[^>]*>', text))
        assert all("alt=" in tag for tag in re.findall(r"<img[^>]*>", text))
        boxes = re.findall(r"<input[^>]*task-list-item[^>]*>", text)
        assert all("aria-label" in tag for tag in boxes)


def test_site_reference_has_usage_of_all_commands(site):
    usage = "".join(path.read_text() for path in site.glob("tools/docs/commands-*.html"))
    for name in COMMANDS:
        assert re.search(rf"<h[12]>{name}<", usage), name
        shown = re.search(rf"<pre[^>]*><span></span>{name}\b", usage)
        assert f"usage: {name}" in usage or shown, name


def test_readme_and_performance_page_equal_stored_results():
    for page in (kept.README.read_text(), kept.PAGE.read_text()):
        assert kept.filled(page) == page, "run python tools/docs/site/kept.py"
    for row in json.loads((RESULTS / "table1.json").read_text())["rows"]:
        if row["method"] == "closed-loop":
            assert f"| {100 * row['success_rate']:.2f} % | {row['mean_squeezes']:.2f} |" in page


def test_site_results_page_contains_all_tables(site):
    written = kept.LISTING.read_text()
    names = [result[1] for result in kept.PLACE.finditer(written)]
    assert len(names) == len(set(names)) > 30
    page = words_of(text_of(site / "tools/docs/results.html"))
    for name in names:
        for line in kept.table_of(name).splitlines():
            assert words_of(line) in page, f"{name}: {line}"


def test_results_page_lists_all_result_files_benches_and_commands():
    page = kept.LISTING.read_text()
    shown = {result[1].partition("-")[0] for result in kept.PLACE.finditer(page)}
    assert {path.stem for path in RESULTS.iterdir()} <= shown
    benches = {path.name for path in (ROOT / "tests" / "bench").glob("bench_*.py")}
    assert benches <= set(re.findall(r"tests/bench/(\w+\.py)", page))
    modules = json.loads((RESULTS / "mutation.json").read_text())["modules"]
    assert [name for name in modules if not (ROOT / name).is_file()] == []
    for section in page.split("\n## ")[1:]:
        assert "```console" in section, section.splitlines()[0]


def test_filled_replaces_tables_between_marks(monkeypatch, tmp_path):
    monkeypatch.setattr(kept, "RESULTS", tmp_path)
    page = "a\n\n<!-- table push_actions -->\nold\n<!-- end -->\n\nb\n"
    assert kept.filled(page) == page.replace("old", "\nNot measured in this version.\n")
    row = {"squeezes": 2.5, "success": 0.99, "crashes": 3, "parts": 100, "pushes": 0.0}
    row |= {"seconds": 5.0, "cpu_s": 9.0}
    other = {**row, "squeezes": 2.1, "crashes": 6}
    figures = {"plate": {"squeezes": [row, other], "pushes": [{"no_plan": "none", "cpu_s": 1.0}]}}
    (tmp_path / "push_actions.json").write_text(json.dumps(figures))
    result = kept.filled(page)
    assert "| plate | none | 2.30 | 99.00 % | 4.5 of 100 | 0.0 | 5.0 | 9 s |" in result
    assert "| plate | belief | no plan |" in result
    assert kept.filled(result) == result
    with pytest.raises(AttributeError):
        kept.table_of("nothing")


def test_table_of_several_seeds_states_mean_least_and_most(monkeypatch, tmp_path):
    monkeypatch.setattr(kept, "RESULTS", tmp_path)
    plan = {"planner": "now", "part": "rectangle-25", "wrong": 0.001, "cpu_s": 30.0}
    plans = [plan | {"success": 0.99 + 0.001 * k, "squeezes": 2.8 + 0.1 * k} for k in range(4)]
    before = plans[0] | {"planner": "before"}
    (tmp_path / "planner.json").write_text(json.dumps([*plans, before]))
    result = kept.table_of("planner")
    row = "| rectangle-25 | now | 4 | 2.95 (2.80 to 3.10) | 99.15 % | 0.10 % | 3.80 | 30 |"
    assert row in result
    row = "| rectangle-25 | before | 1 | 2.80 (2.80 to 2.80) | 99.00 % | 0.10 % | 3.80 | 30 |"
    assert row in result
    shown = "| rectangle-25 | 4 | 99.15 (99.00 to 99.30) % | 2.95 (2.80 to 3.10) |"
    assert shown in kept.table_of("planner-readme")
