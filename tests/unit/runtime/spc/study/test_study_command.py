"""`grasp-audit study`: a verdict with its own exit code, the sheet, the plan; errors are one line."""

import csv
import json
import shlex
from dataclasses import replace

import numpy as np
import pytest
from audited_journals import TABLE, Chain, write
from documents import DOCS, ROOT, blocks, matches
from gauge_readings import AIAG
from histories import TREE, drawn
from sample_tables import several_table

from drivers.camera.commands import audit
from runtime.spc.history import NodeReading, Part
from runtime.table import dump, load


def main(*words):
    return audit(["study", *map(str, words)])


def output(capsys):
    return json.loads(capsys.readouterr().out)


def one_line(capsys):
    said = capsys.readouterr().err
    assert said.count("\n") == 1, said
    return said


@pytest.fixture(scope="module")
def healthy():
    return drawn(TABLE, 700, np.random.default_rng(1))


def test_study_healthy_cell_is_accepted_and_sheet_written(healthy, tmp_path, capsys):
    journal, sheet = write(tmp_path / "j.jsonl", healthy), tmp_path / "sheet.html"
    assert main(journal, "-o", sheet, "--json") == 0
    result = output(capsys)
    assert result["verdict"] == "accepted"
    assert result["parts_least"] <= result["decided_at"] <= 700
    failures = result["failures"]
    assert failures["low"] <= failures["share"] <= failures["high"] < 0.01
    assert result["good"] + result["failed"] + result["not_known"] == result["counted"] == 700
    rows = result["type1"]
    assert sum(row["readings"] for row in rows["leaves"]) == rows["table"]["readings"]
    residuals = np.array([part.residual for part in healthy if part.residual])
    assert rows["table"]["x_mm"]["bias"] == pytest.approx(-residuals[:, 0].mean())
    tolerance = 2 * TABLE.goal.distance_um / 1000
    sigma = residuals[:, 1].std(ddof=1)
    assert rows["table"]["y_mm"]["cg"] == pytest.approx(0.2 * tolerance / (6 * sigma))
    few = [row for row in rows["leaves"] if row["readings"] < 25]
    assert few
    assert all(row["x_mm"]["capable"] is None for row in few)
    assert main(journal) == 0
    assert capsys.readouterr().out.startswith("accepted after ")
    text = sheet.read_text()
    assert "Accepted after" in text
    assert "Signatures" in text
    assert "@media print" in text
    assert text.count('class="next"') == 1  # one break: two sheets of paper
    assert text.count("<tr>") < 45
    assert "http" not in text.replace("http-equiv", "")


def test_study_tiny_scatter_prints_cg_over_100(healthy, tmp_path, capsys):
    still = [
        replace(part, residual=(1e-9 * number, 0.0, 0.0)) if part.residual else part
        for number, part in enumerate(healthy)
    ]
    sheet = tmp_path / "sheet.html"
    main(write(tmp_path / "j.jsonl", still), "-o", sheet)
    assert "Cg over 100, Cgk over 100" in capsys.readouterr().out
    assert "<td>over 100</td><td>over 100</td>" in sheet.read_text()


@pytest.mark.parametrize(("rate", "count", "code"), [(0.2, 200, 11), (0.01, 60, 12)])
def test_study_bad_cell_is_refused_and_few_parts_stay_undecided(
    tmp_path, capsys, rate, count, code
):
    parts = drawn(TABLE, count, np.random.default_rng(2), fail_rate=rate)
    assert main(write(tmp_path / "j.jsonl", parts)) == code
    said = capsys.readouterr().out.splitlines()[0]
    assert said.startswith("refused after" if code == 11 else "not decided yet")


def with_truth(path, parts, off_mm):
    """A journal without audits; its simulated parts lie `off_mm` from their leaves' poses."""
    with Chain(path) as journal:
        journal.header(TABLE)
        for part in parts:
            journal.record("part", {"part": part.number})
            end = {"outcome": part.outcome, "leaf": part.leaf, "audit": None}
            journal.record("outcome", {"part": part.number, **end})
            if part.leaf is not None:
                leaf = TABLE.leaves[part.leaf]
                place = {"x_um": leaf.x_um + round(1000 * off_mm), "y_um": leaf.y_um}
                true = {**place, "theta_urad": leaf.theta_urad, "within_goal": off_mm < 3.0}
                journal.record("truth", {"part": part.number, **true})
        journal.record("end", {})
    return path


def test_study_truth_judges_unaudited_simulated_parts(healthy, tmp_path, capsys):
    journal = with_truth(tmp_path / "j.jsonl", healthy, 0.5)
    assert main(journal) == 2
    assert "--audit" in one_line(capsys)
    assert main(journal, "--truth", "--json") == 0
    study = output(capsys)["type1"]["table"]
    assert study["x_mm"]["bias"] == pytest.approx(-0.5)
    assert study["y_mm"]["sigma"] == 0.0
    assert main(with_truth(tmp_path / "k.jsonl", healthy, 4.0), "--truth") == 11


def crossed_journals(folder, audited=True):
    """Journals of three cells that squeeze the same ten parts three times each; widths scatter by 0.3 mm."""
    rng = np.random.default_rng(3)
    widths = rng.uniform(29_000, 32_000, 10)
    paths = []
    for cell in range(3):
        seen = {"verdict": "pass", "residual": (0.1, 0.1, 0.0)} if audited else {}
        located = []
        for number in range(30):
            width = round(widths[number % 10] + rng.normal(200.0 * cell, 300.0))
            squeezes = (NodeReading(0, 0, width),)
            located.append(Part(number, squeezes, "leaf", leaf=number % 3, **seen))
        paths.append(write(folder / f"cell{cell}{'' if audited else '-bare'}.jsonl", located))
    return paths


def test_study_crossed_takes_journals_as_appraisers(tmp_path, capsys):
    paths = crossed_journals(tmp_path)
    assert main(*paths, "--crossed", 10, "-o", tmp_path / "s.html", "--json") == 12
    result = output(capsys)["crossed"]
    assert set(result) == {"width_mm", "x_mm", "y_mm", "theta_rad"}
    width = result["width_mm"]
    assert (width["parts"], width["appraisers"], width["trials"]) == (10, 3, 3)
    assert width["anova"]["repeatability"] == pytest.approx(0.3, rel=0.3)
    assert 0.0 < width["anova"]["gauge_percent"] < 100.0
    assert "Gauge R&amp;R" in (tmp_path / "s.html").read_text()
    bare = crossed_journals(tmp_path, audited=False)
    assert main(*bare, "--crossed", 10, "--json") == 11
    assert output(capsys)["crossed"]["width_mm"] == width
    assert main(*bare, "--crossed", 10, "-o", tmp_path / "t.html") == 2
    assert "no audited part" in one_line(capsys)


@pytest.mark.parametrize(
    ("cells", "parts", "says"),
    [
        *((3, parts, f"--crossed {parts}") for parts in (7, 30, 1)),
        (1, 10, "at least two of each"),
    ],
)
def test_study_crossed_unbalanced_journals_are_refused(tmp_path, capsys, cells, parts, says):
    assert main(*crossed_journals(tmp_path)[:cells], "--crossed", parts) == 2
    assert says in one_line(capsys)


def measured(path, change=lambda rows: rows):
    readings = np.ndenumerate(np.array(AIAG))
    rows = [[f"P{part}", "ABC"[who], float(value)] for (part, who, _), value in readings]
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([["part", "appraiser", "value"], *change(rows)])
    return path


def test_study_measurements_equal_aiag_example(tmp_path, capsys):
    assert main("--measurements", measured(tmp_path / "m.csv"), "--json") == 0
    result = output(capsys)["crossed"]["value"]
    assert result["anova"]["gauge_percent"] == pytest.approx(27.86, abs=0.005)
    assert result["anova"]["ndc"] == 4
    assert result["anova"]["ndc_unrounded"] == pytest.approx(4.861, abs=0.001)
    assert result["average_and_range"]["gauge_percent"] == pytest.approx(26.68, abs=0.005)
    assert main("--measurements", measured(tmp_path / "m.csv")) == 0
    assert "%GRR 27.86 (may do), ndc 4" in capsys.readouterr().out
    order = np.random.default_rng(1).permutation(90)
    shuffled = measured(tmp_path / "s.csv", lambda rows: [rows[k] for k in order])
    assert main("--measurements", shuffled, "--json") == 0
    shuffled_percent = output(capsys)["crossed"]["value"]["anova"]["gauge_percent"]
    assert shuffled_percent == pytest.approx(result["anova"]["gauge_percent"])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda rows: rows[:-1], "equally often"),
        (lambda rows: [["P0", "A", 1.0]], "at least two of each"),
        (lambda rows: [], "at least two of each"),
        (lambda rows: [*rows[:5], ["P9", "A", "nan"]], "row 7: 'nan' is not a number"),
        (lambda rows: [*rows[:5], ["P9", "A"]], "row 7: '' is not a number"),
        (lambda rows: [*rows[:5], ["P9", "A", "10", "91"]], "row 7: has more fields"),
        (lambda rows: [*rows[:5], ["P9", "A", "-1e200"]], "row 7: -1e200 is beyond 1e+12"),
        (lambda rows: [["P0", "A", 1.0], ["P0", "A", 2.0]], "at least two of each"),
    ],
)
def test_study_invalid_measurements_print_one_line(tmp_path, capsys, change, says):
    assert main("--measurements", measured(tmp_path / "m.csv", change)) == 3
    assert says in one_line(capsys)


def test_study_plan_prints_parts_needed_or_that_none_suffices(tmp_path, capsys):
    assert main("--plan", TREE, "--json") == 0
    result = output(capsys)
    assert 0 < result["parts_least"] <= result["parts_likely"] < 2000
    assert result["parts_type1"] > 25
    table = load(TREE).table
    worse = replace(table, predicted=replace(table.predicted, success_ppm=980_000))
    dump(worse, tmp_path / "worse.msgpack")
    assert main("--plan", tmp_path / "worse.msgpack") == 11
    assert "no number of parts" in capsys.readouterr().out
    assert main("--plan", TREE, "--required", "0.9999999999") == 11
    assert "accepted   never" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        ([], 2, "name journals"),
        (["none.jsonl"], 24, "cannot be read"),
        (["{few}"], 2, "10 measured parts; a type-1 study takes 25"),
        (["{unaudited}"], 2, "no audited part"),
        (["{few}", "{other}"], 2, "is of another table"),
        (["{broken}"], 24, "does not have its digest"),
        (["{empty}"], 2, "no part yet"),
        (["{few}", "--plan", "t"], 2, "name journals"),
        (["{few}", "--required", "1"], 2, "no share between 0 and 1"),
        (["{few}", "--required", "1e-300"], 2, "no share between 0 and 1"),
        (["{few}", "{few}"], 2, "name each journal once"),
        (["--plan", "t", "--truth"], 2, "need journals"),
        (["--plan", "none.msgpack"], 3, "none.msgpack"),
        (["--measurements", "none.csv"], 3, "none.csv"),
        (["--measurements", "{few}"], 3, "write the columns"),
        (["{few}", "-o", "{few}"], 2, "the same file"),
    ],
)
def test_study_bad_input_prints_one_line(healthy, tmp_path, capsys, words, code, says):
    bare = [replace(part, verdict=None, residual=None) for part in healthy[:40]]
    paths = {
        "few": write(tmp_path / "few.jsonl", [part for part in healthy[:20] if part.residual][:10]),
        "other": write(tmp_path / "other.jsonl", [], tree=several_table()),
        "unaudited": write(tmp_path / "bare.jsonl", bare),
        "broken": write(tmp_path / "broken.jsonl", healthy[:30]),
        "empty": write(tmp_path / "empty.jsonl", []),
    }
    paths["broken"].write_bytes(paths["broken"].read_bytes().replace(b'"pass"', b'"Pass"', 1))
    given = [word.format(**paths) for word in words]
    with pytest.raises(SystemExit) as ended:  # as argparse does
        raise SystemExit(main(*given))
    assert ended.value.code == code
    assert says in one_line(capsys)


def test_acceptance_page_commands_print_documented_output(healthy, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "trees").symlink_to(ROOT / "trees")
    write(tmp_path / "run-off.jsonl", healthy)
    (tmp_path / "made").mkdir()
    for number, path in enumerate(crossed_journals(tmp_path / "made"), 1):
        path.rename(tmp_path / f"cell{number}.jsonl")
    for block in blocks(DOCS / "acceptance.md"):
        (line,) = block.commands
        assert audit(shlex.split(line)[1:]) in (0, 12)
        assert matches(block.printed, capsys.readouterr().out.splitlines())
