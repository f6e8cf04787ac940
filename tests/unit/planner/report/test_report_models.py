"""The quality of learned models on a table's page: the file's figures, or a line that says what to do."""

import json
import re
from pathlib import Path

import pytest
from html_pages import Page

from planner.cli import report
from planner.errors import InputFileError
from planner.job import model as job_file
from planner.report import dossier, models
from runtime.table import dumps, load

TABLE_PATH = Path(__file__).parents[4] / "trees" / "rectangle" / "rectangle.msgpack"
TABLE = load(TABLE_PATH).table
DIGEST = TABLE.job_digest.hex()
CONFUSION = {"colliding": 4000, "free": 96000, "miss_rate": 0.00025, "false_alarm_rate": 0.0125}
ACTION = {"x_mm": 0.0, "y_mm": -1.5, "model_mm": 0.0012, "simulator_mm": 0.001, "simulated": 0.04}
FIGURES = {
    "job_digest": DIGEST,
    "rollouts": 20_000,
    "colliding": 0.125,
    "spacing_mm": 1.25,
    "h1_mm": 0.345,
    "h2_mm": 0.05,
    "actions": [
        {**ACTION, "theta_rad": 0.0, "ratio": 1.2},
        {**ACTION, "theta_rad": 0.7853981633974483, "ratio": None},
    ],
    "actions_in_collision": 3,
    "sensor": {"median_mm": 0.0321, "q95_mm": 0.115, "worst_mm": 1.5, "held_out": 4000},
    "collision": CONFUSION,
    "subspaces": [
        {"low_mm": 0.0, "mean_mm": 0.0, "high_mm": 0.5, "rollouts": 15_000},
        {"low_mm": 20.5, "mean_mm": 21.0, "high_mm": 21.5, "rollouts": 5_000},
    ],
    "notes": ["widths <b>close</b> together"],
    "picture": "tree.models.svg",
}


def written(folder: Path, told: object) -> Path:
    path = folder / "models.json"
    path.write_text(told if isinstance(told, str) else json.dumps(told))
    return path


def test_what_the_compiler_wrote_is_read_as_it_is(tmp_path):
    result = models.read(written(tmp_path, FIGURES), DIGEST)
    assert result == without("picture")


def test_what_the_compiler_printed_as_json_will_do(tmp_path):
    printed = {"table": "t", "models": FIGURES, "advice": None}
    assert models.read(written(tmp_path, printed), DIGEST) == models.read(
        written(tmp_path, FIGURES), DIGEST
    )


def without(name):
    return {key: value for key, value in FIGURES.items() if key != name}


@pytest.mark.parametrize(
    "told",
    [
        "",
        "{",
        "[" * 100_000,
        "7",
        "null",
        "[]",
        "{}",
        '{"models": 3}',
        *(without(name) for name in FIGURES if name != "picture"),
        {**FIGURES, "h1_mm": "wide"},
        {**FIGURES, "h1_mm": float("nan")},
        {**FIGURES, "rollouts": float("inf")},
        {**FIGURES, "actions": [{}]},
        {**FIGURES, "sensor": []},
        {**FIGURES, "subspaces": 4},
        {**FIGURES, "job_digest": "ab" * 32},
    ],
    ids=lambda told: None,
)
def test_what_is_no_such_file_is_one_line_that_says_how_to_get_one(tmp_path, told):
    with pytest.raises(InputFileError, match="plan-compile --models-report") as refused:
        models.read(written(tmp_path, told), DIGEST)
    assert "\n" not in str(refused.value)
    assert str(tmp_path / "models.json") in str(refused.value)


def test_a_file_that_is_not_there_or_a_folder_or_too_large_is_one_line(tmp_path, monkeypatch):
    for path in (tmp_path, tmp_path / "none.json"):
        with pytest.raises(InputFileError, match="cannot be read"):
            models.read(path, DIGEST)
    monkeypatch.setattr(models, "MAX_BYTES", 100)
    with pytest.raises(InputFileError, match="is larger than"):
        models.read(written(tmp_path, FIGURES), DIGEST)


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The same page without and with models."""
    folder = tmp_path_factory.mktemp("models")
    words = [str(TABLE_PATH), "--trials", "50"]
    plain, full = folder / "plain.html", folder / "full.html"
    assert report.main([*words, "-o", str(plain)]) == 0
    assert report.main([*words, "-o", str(full), "--models", str(written(folder, FIGURES))]) == 0
    return plain.read_text(), full.read_text()


def test_the_page_shows_the_figures(pages):
    _, text = pages
    rows = [re.sub(r"<[^>]+>", " ", row).split() for row in re.findall(r"<tr>.*</tr>", text)]
    assert ["0.0", "0.0", "-1.5", "0.00120", "0.00100", "1.20", "4", "%"] in rows
    assert ["45.0", "0.0", "-1.5", "0.00120", "0.00100", "\N{EN DASH}", "4", "%"] in rows
    assert "the greatest here is 1.20" in text
    assert "0.025 % of 4000 colliding ones called free, 1.25 % of 96000 free ones" in text
    assert "0.115 mm in 95 % of 4000 roll-outs held out" in text
    assert "3 more actions collide with the belief" in text
    assert "20.5\N{EN DASH}21.5 mm" in text
    assert "&lt;b&gt;close&lt;/b&gt;" in text


def test_the_page_stays_whole_and_is_the_same_but_for_the_models(pages):
    plain, full = pages
    assert not Page(full).open
    assert Page(full).scripts == Page(plain).scripts
    assert "learned models" not in plain
    start = full.index("<h2>How good the learned models are</h2>")
    assert full[:start] + full[full.index("<h2>The job</h2>") :] == plain


def test_wide_models_and_none_at_all_are_drawn_within_the_chart():
    job = job_file.from_canonical(TABLE.job)
    span = {"low_mm": 0.0, "mean_mm": 50.0, "high_mm": 200.0, "rollouts": 1}
    record = {**FIGURES, "actions": [], "subspaces": [span]}
    text = dossier.page(TABLE, job, dossier.Source("t", dumps(TABLE), None, record), 50)
    assert "200 mm" in text
    bare = dossier.Source("t", dumps(TABLE), None, {**record, "subspaces": []})
    assert "What widths stand for" not in dossier.page(TABLE, job, bare, 50)
    assert "the greatest here" not in text


def test_models_of_another_job_are_refused_before_the_work(tmp_path, capsys):
    path = written(tmp_path, {**FIGURES, "job_digest": "ab" * 32})
    words = [str(TABLE_PATH), "-o", str(tmp_path / "page.html"), "--models", str(path)]
    assert report.main(words) == 3
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert "about another job" in printed
    assert not (tmp_path / "page.html").exists()
