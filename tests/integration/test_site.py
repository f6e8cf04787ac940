"""The site is built with warnings as errors, every link in it leads somewhere, and it loads nothing."""

import importlib.util
import json
import re
import subprocess
import sys
import tomllib
from html import unescape
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SITE = ROOT / "tools" / "docs" / "site"
RESULTS = ROOT / "tests" / "bench" / "results"
COMMANDS = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]


def module(name):
    """A module of the site's builder, which is no package."""
    found = importlib.util.spec_from_file_location(f"site_{name}", SITE / f"{name}.py")
    loaded = importlib.util.module_from_spec(found)
    found.loader.exec_module(loaded)
    return loaded


@pytest.fixture(scope="module")
def links():
    return module("links")


@pytest.fixture(scope="module")
def kept():
    return module("kept")


def build(*arguments):
    return subprocess.run(
        [sys.executable, str(SITE / "build.py"), *arguments],
        capture_output=True, text=True, timeout=240, check=False,
    )  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    output = tmp_path_factory.mktemp("site") / "built"
    done = build("-o", str(output))
    assert (done.returncode, done.stderr) == (0, "")
    assert "not fetched" in done.stdout
    return output


def text_of(page):
    """What a reader sees of a page."""
    return unescape(re.sub(r"<[^>]+>", "", page.read_text()))


def test_the_start_page_is_the_readme(site):
    start = site / re.search(r"url=(\S+)\"", (site / "index.html").read_text())[1]
    assert "A robot that feels instead of looks" in text_of(start)


@pytest.mark.parametrize(
    "source",
    [
        *(
            "README.md",
            "CHANGELOG.md",
            "runtime/table/TABLE.md",
            "runtime/OUTCOMES.md",
            "drivers/sim/FAULTS.md",
        ),
        *("drivers/abb/README.md", "drivers/camera/README.md"),
        *(str(path.relative_to(ROOT)) for path in sorted((ROOT / "tools").glob("d*s/[!T]*.md"))),
    ],
)
def test_every_document_is_a_page(site, source):
    page = (site / source).with_suffix(".html")
    title = re.search(r"^# (.+)$", (ROOT / source).read_text(), re.MULTILINE)[1]
    assert re.sub(r"\W", "", title.replace("`", "")) in re.sub(r"\W", "", text_of(page))


def test_every_link_leads_somewhere_and_nothing_is_loaded_from_elsewhere(site, links):
    found = links.check(site)
    assert found.faults == []
    assert all(address.startswith("https://") for address in found.outside)


def test_formulas_are_drawn(site):
    page = (site / "tools/docs/how-it-works.html").read_text()
    drawn = re.findall(r'<svg role="img" aria-label="([^"]*)"', page)
    written = re.findall(
        r"\$\$.*?\$\$|\$[^$\n]+\$", (ROOT / "tools/docs/how-it-works.md").read_text(), re.DOTALL
    )
    assert len(drawn) == len(written) >= 30
    heights = [float(em) for em in re.findall(r'<svg role="img"[^>]* height="([\d.]+)em"', page)]
    assert len(heights) == len(drawn)
    assert max(heights) < 6.0  # a bracket that grew without bounds would show here
    assert "\\mathbf" not in text_of(site / "tools/docs/how-it-works.html")


def test_what_scrolls_is_reached_by_key_and_what_is_there_has_a_name(site):
    for page in site.rglob("*.html"):
        text = page.read_text()
        for tag in re.findall(r"<pre[^>]*>|<div[^>]*table-wrapper[^>]*>|<p[^>]*>(?=<img)", text):
            assert 'tabindex="0"' in tag, f"{page.name}: {tag}"
        assert all("aria-level" in tag for tag in re.findall(r'<[^>]*role="heading"[^>]*>', text))
        assert all("alt=" in tag for tag in re.findall(r"<img[^>]*>", text))
        assert all("aria-label" in tag for tag in re.findall(r"<input[^>]*task-list-item[^>]*>", text))


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_in_the_reference(site, command):
    pages = [path.read_text() for path in site.glob("tools/docs/commands-*.html")]
    assert any(re.search(rf"<h[12]>{command}<", page) for page in pages)
    usage = "".join(pages)
    assert f"usage: {command}" in usage or re.search(rf"<pre[^>]*><span></span>{command}\b", usage)


def test_the_performance_page_holds_what_is_kept(kept):
    for page in (kept.README.read_text(), kept.PAGE.read_text()):
        assert kept.filled(page) == page, "run python tools/docs/site/kept.py"
    for row in json.loads((RESULTS / "table1.json").read_text())["rows"]:
        if "success_rate" in row:
            assert f"{100 * row['success_rate']:.3f} (" in page


def test_every_file_of_figures_is_on_the_page_with_its_command(kept):
    page = kept.PAGE.read_text()
    shown = {found[1].partition("-")[0] for found in kept.PLACE.finditer(page)}
    assert {path.stem for path in RESULTS.glob("*.json")} <= shown
    benches = {path.name for path in (ROOT / "tests" / "bench").glob("bench_*.py")}
    assert benches <= set(re.findall(r"tests/bench/(\w+\.py)", page))
    for section in page.split("\n## ")[1:]:
        assert "```console" in section, section.splitlines()[0]


def test_tables_are_filled_in_where_the_page_says(kept, monkeypatch, tmp_path):
    monkeypatch.setattr(kept, "RESULTS", tmp_path)
    page = "a\n\n<!-- table push_actions -->\nold\n<!-- end -->\n\nb\n"
    assert kept.filled(page) == page.replace("old", "\nNot measured in this version.\n")
    row = {
        "squeezes": 2.5,
        "success": 0.99,
        "crashes": 3,
        "parts": 100,
        "pushes": 0.0,
        "seconds": 5.0,
        "cpu_s": 9.0,
    }
    other = {**row, "squeezes": 2.1, "crashes": 6}
    figures = {"plate": {"squeezes": [row, other], "pushes": [{"no_plan": "none", "cpu_s": 1.0}]}}
    (tmp_path / "push_actions.json").write_text(json.dumps(figures))
    made = kept.filled(page)
    assert "| plate | none | 2.30 | 99.00 % | 4.5 of 100 | 0.0 | 5.0 | 9 s |" in made
    assert "| plate | belief | no plan |" in made
    assert kept.filled(made) == made
    with pytest.raises(AttributeError):
        kept.table_of("nothing")


def test_figures_over_seeds_are_told_as_mean_least_and_most(kept, monkeypatch, tmp_path):
    monkeypatch.setattr(kept, "RESULTS", tmp_path)
    values = {"mean": 0.995, "deviation": 0.001, "least": 0.99, "most": 0.9975}
    squeezes = {"mean": 3.01, "deviation": 0.1, "least": 2.8, "most": 3.13}
    spread = {"success_rate": values, "wrong_rate": values, "mean_squeezes": squeezes}
    plans = [{"seed": seed, "part": "rectangle-25"} for seed in range(1, 11)]
    rows = [{"row": "5", "method": "closed-loop", "spread": spread, "plans": plans}]
    rows.append({"row": "5", "method": "paper", "spread": {}, "plans": plans})
    (tmp_path / "table1_seeds.json").write_text(json.dumps(rows))
    page = kept.table_of("table1_seeds")
    assert "| 5 | rectangle-25 | closed-loop | 10 | 99.50 (99.00 to 99.75) % |" in page
    assert "| 3.01 (2.80 to 3.13) |" in page
    assert "| 5 | rectangle-25 | paper | 10 | no plan |" in page
    shown = kept.table_of("table1_seeds-readme")
    assert "With each of 10 seeds" in shown
    assert shown.count("rectangle-25") == 1


FAULTY = """<html><head><script src="https://cdn.example/x.js"></script></head><body>
<a href="#there">fine</a><a href="#nowhere">no anchor</a><a href="missing.html">no file</a>
<a href="other.html#far">no anchor there</a><a href="https://example.org/">outside</a>
<p id="there"></p><p id="twice"></p><p id="twice"></p></body></html>"""


def test_the_check_of_links_finds_what_is_wrong(links, tmp_path):
    (tmp_path / "index.html").write_text(FAULTY)
    (tmp_path / "other.html").write_text("<p id='near'></p>")
    (tmp_path / "a.css").write_text("@import 'https://fonts.example/a'; b { c: url(https://x.example/i) }")
    found = links.check(tmp_path)
    assert found.outside == ["https://example.org/"]
    wrong = ["x.js from elsewhere", "#nowhere leads to no anchor", "missing.html leads to no file"]
    wrong += ["other.html#far leads to no anchor", "twice is there 2 times", "fonts.example/a", "x.example/i"]
    assert len(found.faults) == len(wrong)
    for text in wrong:
        assert any(text in fault for fault in found.faults), text


def test_a_page_with_a_warning_fails(tmp_path):
    (tmp_path / "README.md").write_text("# Start\n\n[away](nowhere.md)\n")
    strict = module("build").STRICT
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", *strict, str(tmp_path), str(tmp_path / "out")],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode != 0
    assert "nowhere.md" in done.stderr


def test_a_folder_with_something_else_is_not_replaced(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    done = build("-o", str(tmp_path))
    assert (done.returncode, "something else" in done.stderr) == (2, True)
    assert (tmp_path / "thesis.txt").exists()
