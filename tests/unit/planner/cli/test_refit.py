"""plan-refit: the job that it writes keeps the comments of the old one; errors are one line."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
from programs import called, document
from rectangle import JOB_PATH as JOB
from rectangle import TABLE_PATH as TREE
from run_logs import chained, header, part

from planner.cli import refit
from planner.evaluation.trials import encoder_of_table
from planner.job import model
from planner.refit.cells import Cells
from planner.refit.posterior import Posterior
from planner.work.scheduler import Threads
from runtime.shell.errors import InputError
from runtime.table import load


def journal(path: Path, parts: int, table: Path = TREE, seed: int = 1) -> Path:
    """Writes the journal of a cell whose encoder reads 0.6 mm too much."""
    loaded = load(TREE)
    cells = Cells.of(model.from_canonical(loaded.table.job), loaded.table)
    values = {"encoder_mm": 0.6, "finger_part_min": 0.4, "finger_part_max": 0.6}
    point = np.array([*(values.get(quantity.key, 0.0) for quantity in cells.space.quantities), 0.0])
    run, entries = cells.run(point, parts, seed), [header(table.read_bytes())]
    for number in range(parts):
        leaf = int(run.leaf[number]) if run.leaf[number] >= 0 else None
        ways = [int(node) for node in run.path[number] if node >= 0]
        ends = [*ways[1:], None if leaf is None else ~leaf]
        widths = map(int, encoder_of_table(loaded.table).width_um(run.steps[number]))
        steps = list(zip(ways, widths, ends, strict=False))
        entries += part(number + 1, steps, "reject" if leaf is None else "leaf", leaf)
    path.write_bytes(chained(entries))
    return path


@pytest.mark.slow
def test_refit_learns_the_encoder_offset_and_leaves_its_inputs_unchanged(tmp_path):
    seen, output = journal(tmp_path / "run.jsonl", 60), tmp_path / "job2.toml"
    for path in (JOB, TREE):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    job = tmp_path / JOB.name
    words = [job, "--journal", seen, "-o", output, "--cells", "20", "--json"]
    findings = document(refit.main, *words)["findings"]
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path != output} == before
    record = {finding["quantity"]: finding for finding in findings}
    assert record["encoder_mm"]["learned"]
    assert record["encoder_mm"]["mean"] == pytest.approx(0.6, abs=0.1)
    low, high = tomllib.loads(output.read_text())["doubt"]["encoder_mm"]
    assert 0.4 < low < high < 0.8
    kept = [line for line in JOB.read_text().splitlines() if line.strip().startswith("#")]
    assert set(kept) <= set(output.read_text().splitlines())


def test_refit_onto_a_table_that_a_cell_may_run_is_refused(tmp_path):
    tree = tmp_path / "t.msgpack"
    tree.write_bytes(TREE.read_bytes())
    seen = journal(tmp_path / "run.jsonl", 20)
    ended = called(refit.main, JOB, "--journal", seen, "-o", tree)
    assert (ended.code, ended.one_line) == (2, True)
    assert "is a table, which a cell may run" in ended.err
    assert tree.read_bytes() == TREE.read_bytes()


def test_edited_keeps_comments_and_adds_missing_sections():
    text = "a = 1  # one\n[friction]  # two\nfinger_part_min = 0.4  # three\n"
    changed = {"friction": {"finger_part_min": 0.3}, "doubt": {"encoder_mm": [0.1, 0.2]}}
    result = refit.edited(text, changed)
    assert tomllib.loads(result) == {"a": 1, **changed}
    assert all(word in result for word in ("# one", "# two", "# three"))


@pytest.mark.parametrize(
    ("change", "code", "word"),
    [
        (lambda d: ["--journal", str(d / "none.jsonl")], 3, "cannot be read"),
        (lambda d: ["--journal", str(journal(d / "few.jsonl", 5))], 2, "too few"),
        (lambda d: ["--journal", str(broken(d))], 3, "does not verify"),
        (lambda d: [*other_job(d)], 3, "another job"),
    ],
)
def test_refit_unusable_journal_is_refused_in_one_line(tmp_path, change, code, word):
    arguments = change(tmp_path)
    job = [] if arguments[0].endswith(".toml") else [JOB]
    output = tmp_path / "job2.toml"
    ended = called(refit.main, *job, *arguments, "-o", output)
    assert (ended.code, ended.one_line) == (code, True)
    assert word in ended.err
    assert not output.exists()


def broken(folder: Path) -> Path:
    path = journal(folder / "broken.jsonl", 25)
    path.write_bytes(path.read_bytes().replace(b'"outcome":"leaf"', b'"outcome":"lear"', 1))
    return path


def other_job(folder: Path) -> list[str]:
    path = folder / "other.toml"
    path.write_text(JOB.read_text().replace("finger_part_max = 0.6", "finger_part_max = 0.7"))
    return [str(path), "--journal", str(journal(folder / "run.jsonl", 25))]


def arguments(*words: object):
    """The parsed command line of a refit with these words."""
    return refit.parser().parse_args([str(JOB), "-o", "j.toml", *map(str, words)])


def test_refit_job_of_a_first_answer_that_searched_less_is_accepted(tmp_path):
    words = arguments("--journal", journal(tmp_path / "run.jsonl", 20))
    more = model.load(JOB).replaced(search={"particles": 30_000})
    assert len(refit._parts(words, more)[1]) == 20
    with pytest.raises(InputError, match="another job"):
        refit._parts(words, more.replaced(seed=99))


@pytest.mark.parametrize("row", ["0,nan,0,0", "0,1e300,0,0", "-1,0,0,0", "20,0,0,0", "3,0,0,0"])
def test_refit_audit_of_no_part_or_without_a_number_is_refused(tmp_path, row):
    audit = tmp_path / "parts.csv"
    audit.write_text(f"index,{','.join(refit.RESIDUAL)}\n3,0.1,-0.1,0.01\n{row}\n")
    words = arguments("--journal", journal(tmp_path / "run.jsonl", 20), "--audit", audit)
    with pytest.raises(InputError, match="no table of its journal's parts"):
        refit._parts(words, model.load(JOB))


def test_preview_of_nothing_learned_is_the_cell_of_the_job():
    """Where a refit learns nothing, the table fails as rarely as in the cell that the job states."""
    loaded = load(TREE)
    cells = Cells.of(model.from_canonical(loaded.table.job), loaded.table)
    prior = Posterior(cells.space.draw(2000, np.random.default_rng(1)), cells.space)
    wrong, rejected = refit._preview(cells, prior, 1, Threads(1))
    assert wrong < 0.01
    assert rejected < 0.01
