"""plan-compile --vary: many jobs from one file, each table as if it had been compiled alone."""

import json
from pathlib import Path

import pytest
from programs import called
from rectangle import CERTAIN, quick_job

from planner.cli import compile as plan_compile
from planner.cli import sweep as sweep_cli
from planner.cli.sweep import Order, orders_of
from runtime.shell.errors import UsageError

RADII = "uncertainty.radius_mm=4,6"


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """The rectangle's job, planned with few particles."""
    folder = tmp_path_factory.mktemp("job")
    return quick_job(folder / "job.toml", "particles = 200\nmax_depth = 3", *CERTAIN)


def compiled(job, output, *options):
    words = (job, "-o", output, "--trials", "100", "--workers", "2", "--no-advice", *options)
    return called(plan_compile.main, *words)


def test_plan_compile_vary_tables_equal_those_compiled_alone(job, tmp_path):
    assert compiled(job, tmp_path / "all", "--vary", RADII, "--vary", "seed=3").code == 0
    for radius in ("4", "6"):
        text = job.read_text(encoding="utf-8")
        edited = text.replace("radius_mm = 12.75", f"radius_mm = {radius}")
        edited = edited.replace("seed = 1", "seed = 3")
        alone = tmp_path / f"{radius}.toml"
        alone.write_text(edited, encoding="utf-8")
        assert compiled(alone, tmp_path / "alone.msgpack").code == 0
        swept = tmp_path / "all" / f"uncertainty.radius_mm={radius},seed=3.msgpack"
        assert swept.read_bytes() == (tmp_path / "alone.msgpack").read_bytes()


def test_plan_compile_vary_bad_values_leave_other_jobs(job, tmp_path):
    values = "uncertainty.radius_mm=-1,4,45"
    code, out, err = compiled(job, tmp_path, "--vary", values, "--json")
    assert code == 3
    bad, good, hopeless = json.loads(out)["jobs"]
    assert err == ""
    assert "[uncertainty] radius_mm" in bad["error"]
    assert bad["exit_code"] == 3
    assert hopeless["exit_code"] == 4
    assert Path(good["table"]).stat().st_size == good["bytes"]
    assert good["success_rate"] > 0.9
    assert json.loads((tmp_path / "summary.json").read_text()) == [bad, good, hopeless]
    assert len(list(tmp_path.glob("*.msgpack"))) == 1


def test_plan_compile_vary_prints_lines_to_pipe_and_table_to_terminal(job, tmp_path, monkeypatch):
    words = job, tmp_path, "--vary"
    code, out, _ = compiled(*words, "uncertainty.radius_mm=4,wide")
    assert code == 3
    first, second = out.splitlines()
    assert first.startswith("uncertainty.radius_mm=4: success ")
    assert str(tmp_path / "uncertainty.radius_mm=4.msgpack") in first
    assert second.startswith("uncertainty.radius_mm=wide: no table: ")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "400")
    code, out, _ = compiled(*words, "uncertainty.radius_mm=wide,wider")
    assert code == 3
    assert "success" in out
    assert "must be a number" in out
    assert "│" in out


def test_plan_compile_vary_interrupt_keeps_finished_tables(job, tmp_path, monkeypatch):
    all_outcomes = sweep_cli.outcomes

    def interrupted(*arguments):
        yield next(all_outcomes(*arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep_cli, "outcomes", interrupted)
    ended = compiled(job, tmp_path, "--vary", RADII)
    assert ended.code == 130
    assert "1 of 2 jobs are done" in ended.err
    assert len(list(tmp_path.glob("*.msgpack"))) == 1


@pytest.mark.parametrize(
    ("sweeps", "words"),
    [
        (["radius"], "write it as section.key=value"),
        (["a.b="], "states no values"),
        (["goal.distance_mm=1", "goal.distance_mm=2"], "swept twice"),
        (
            [f"seed={','.join('1' * 101)}", f"goal.distance_mm={','.join('1' * 101)}"],
            "more than 10000",
        ),
    ],
)
def test_plan_compile_vary_invalid_sweep_is_refused_in_one_line(job, tmp_path, sweeps, words):
    options = [word for text in sweeps for word in ("--vary", text)]
    refused = compiled(job, tmp_path / "none", *options)
    assert (refused.code, refused.one_line) == (2, True)
    assert words in refused.err
    assert not (tmp_path / "none").exists()


def test_orders_of_combinations_follow_command_line(job):
    orders = orders_of(job, ["seed=1,2", "goal.distance_mm=3,4,3"])
    pairs = ((1, 3), (1, 4), (2, 3), (2, 4))
    labels = [f"seed={seed}, goal.distance_mm={distance}" for seed, distance in pairs]
    assert [order.label for order in orders] == labels


def order(**values):
    return Order(tuple(values.items()), "{}")


def test_paths_of_names_files_by_values_within_folder():
    orders = [order(a="[0, 90]", b='"../x"'), order(a="1e-3", b="/etc")]
    names = [path.name for path in sweep_cli.paths_of(orders, Path("out"))]
    assert names == ["a=_0,_90_,b=_.._x.msgpack", "a=1e-3,b=_etc.msgpack"]
    assert {path.parent for path in sweep_cli.paths_of(orders, Path("out"))} == {Path("out")}


def test_paths_of_long_values_are_short_and_distinct():
    outline = "[" + ", ".join(f"[{x}, 0]" for x in range(100))
    orders = [order(a=outline + end) for end in ("]", ", [0, 9]]")]
    paths = sweep_cli.paths_of(orders, Path("out"))
    assert len(set(paths)) == 2
    assert max(len(path.name) for path in paths) < 140


def test_plan_compile_vary_unusable_file_is_refused_in_one_line(job, tmp_path):
    path = tmp_path / "file.toml"
    path.write_text("seed = ")
    none, out = tmp_path / "none.toml", tmp_path / "out"
    for source, output, code in ((none, out, 3), (path, out, 3), (job, path, 2)):
        refused = compiled(source, output, "--vary", RADII)
        assert (refused.code, refused.one_line) == (code, True)


@pytest.mark.parametrize(
    ("folder", "values", "words"),
    [("x.msgpack", ("1", "2"), "name a folder"), ("out", ("{", "}"), "2 jobs would be written")],
)
def test_paths_of_equal_names_are_refused(folder, values, words):
    with pytest.raises(UsageError, match=words):
        sweep_cli.paths_of([order(a=value) for value in values], Path(folder))
