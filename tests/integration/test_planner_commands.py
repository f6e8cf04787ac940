"""The planner's commands as a user types them, with wrong input too."""

import csv
import errno
import os

import pytest
from programs import JOB, TABLE, called, document
from rectangle import CERTAIN, quick_job

from planner.cli import compile as compile_
from planner.cli import evaluate, report, simulate
from runtime.table import load


@pytest.fixture
def quick(tmp_path):
    """The rectangle without doubt about the cell, planned with few particles."""
    return quick_job(tmp_path / "quick.toml", "particles = 1500", *CERTAIN)


def test_plan_evaluate_changed_world_prints_documented_figures():
    slippery = ("--world-set", "friction.finger_part_min=0.15")
    slippery += ("--world-set", "friction.finger_part_max=0.25")
    words = (TABLE, "--trials", 1000, "--encoder-offset-mm", 2.5)
    figures = document(evaluate.main, *words, "--json", "--worst", 2, *slippery)
    assert figures["trials"] == 1000
    names = {"success_rate", "success_ci95", "mean_squeezes", "max_squeezes", "reject_rate"}
    assert names <= set(figures)
    assert figures["reject_rate"] > 0.005
    assert len(figures["worst"]) <= 2
    assert sum(row["trials"] for row in figures["confusions"]) >= 1000 * figures["wrong_rate"] - 0.5
    reliability = document(evaluate.main, TABLE, "--trials", 4000, "--json")["reliability"]
    assert reliability["leaves"] == len(reliability["table"]) > 1
    words = (TABLE, "--trials", 300, *slippery, "--placement-error-mm", 0.5)
    code, out, _ = called(evaluate.main, *words)
    assert code == 0
    assert "friction.finger_part_min=0.15" in out
    assert "placement_mm 0.5" in out


def test_plan_evaluate_sweep_covers_standard_worlds():
    worlds = document(evaluate.main, TABLE, "--trials", 200, "--sweep", "--json")["worlds"]
    assert worlds[0]["world"] == "as planned"
    assert worlds[0]["set"] == {}
    assert len({world["world"] for world in worlds}) == len(worlds) >= 14
    assert all(world["trials"] == 200 for world in worlds)


def test_plan_evaluate_ppm_counts_wrong_answers_and_resumes(tmp_path):
    kept = tmp_path / "study.json"
    for _ in range(2):  # the second run has nothing left to do
        words = (TABLE, "--ppm", "--trials", 10_000, "--json", "--resume", kept)
        record = document(evaluate.main, *words)
        assert record["parts"] == 10_000
        low, rate, high = (record["wrong_ppm"][name] for name in ("low", "rate", "high"))
        assert low <= rate <= high < 5000
        assert len(record["leaves"]) == len(load(TABLE).table.leaves)
    before = kept.read_bytes()
    refused = called(evaluate.main, TABLE, "--ppm", "--seed", 5, "--resume", kept)
    assert (refused.code, refused.one_line) == (3, True)
    assert kept.read_bytes() == before


def test_plan_compile_bound_reports_advice_and_lower_bound(quick, tmp_path):
    path = tmp_path / "out.msgpack"
    words = (quick, "-o", path, "--trials", 1000, "--bound", 2000, "--json")
    figures = document(compile_.main, *words)
    advice, bound = figures["advice"], figures["bound"]
    assert {gain["source"] for gain in advice["gains"]} >= {"pressure", "friction", "encoder noise"}
    assert advice["failing"] == pytest.approx(1.0 - figures["success_rate"])
    assert 1.5 < figures["squeezes_lower_bound"] < figures["mean_squeezes"]
    assert bound["squeezes"] == figures["squeezes_lower_bound"]
    assert (bound["confidence"], bound["leaf_confidence"]) == (0.95, 0.99)
    assert bound["success_rate"] == pytest.approx(figures["success_ci95"][0], abs=1e-5)
    assert set(bound["terms"]) == {"leaves", "overall"}


def test_plan_compile_sensorless_baseline_locates_less_than_70_percent():
    words = (JOB, "--baseline", "sensorless", "--trials", 2000, "--json")
    figures = document(compile_.main, *words)
    assert len(figures["angles_deg"]) == figures["squeezes"] <= figures["most_squeezes"]
    assert figures["ideal"]["oriented"] > 0.98
    assert figures["real"]["located"] < 0.7  # the paper, footnote 2


def write_poses(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("x_mm", "y_mm", "theta_rad"), *rows])


def read_rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_plan_simulate_rows_repeat_inputs_and_add_results(tmp_path):
    write_poses(tmp_path / "in.csv", [(1, 2, 0.3), (100, 0, 0)])
    poses, out = ("--poses", tmp_path / "in.csv"), ("-o", tmp_path / "out.csv")
    code, _, _ = called(simulate.main, JOB, *poses, *out, "--nominal", "--mu", 0.5)
    rows = read_rows(tmp_path / "out.csv")
    assert code == 0
    assert [float(row["x_mm"]) for row in rows] == [1, 100]
    assert rows[0]["status"] in {"grasped", "jammed"}
    assert rows[1]["status"] == "untouched"
    assert float(rows[1]["final_x_mm"]) == 100
    assert float(rows[1]["width_mm"]) == 0


def test_plan_simulate_full_disk_is_refused_and_leaves_no_file(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    write_poses(tmp_path / "in.csv", [(1, 2, 0.3)])
    monkeypatch.setattr(os, "fsync", full)
    poses, out = ("--poses", tmp_path / "in.csv"), ("-o", tmp_path / "out.csv")
    refused = called(simulate.main, JOB, *poses, *out)
    assert (refused.code, refused.one_line) == (2, True)
    assert "out.csv" in refused.err
    assert "free the disk" in refused.err
    assert [path.name for path in tmp_path.iterdir()] == ["in.csv"]


BAD_JOBS = {
    "toml": lambda text: text.replace("[goal]", "[goal"),
    "key": lambda text: text.replace("distance_mm", "distance_mn"),
    "friction": lambda text: text.replace("finger_part_min = 0.4", "finger_part_min = 0.7"),
    "crossing": lambda text: text.replace("[30, 21], [0, 21]]", "[0, 21], [30, 21]]"),
    "large": lambda text: text.replace("[30, 0], [30, 21], [0, 2", "[99, 0], [99, 99], [0, 9"),
}
OUT, CSV = "-o out.msgpack", "-o out.csv"
CHIRAL = "--world-set part.symmetry=1 --world-set part.outline_mm=[[0,0],[30,0],[30,9],[0,20]]"
REFUSED = [
    *((compile_, f"{name}.toml {OUT}", 3, "") for name in BAD_JOBS if name != "key"),
    (compile_, f"key.toml {OUT}", 3, "distance_mm"),
    (compile_, f"none.toml {OUT}", 3, "none"),
    (compile_, "JOB -o none/out.msgpack", 2, "none"),
    (compile_, "JOB -o x.svg", 2, "what is written is a table"),
    (compile_, f"JOB {OUT} --bound 0", 2, ""),
    (compile_, f"JOB {OUT} --bound 1000000000", 2, ""),
    (compile_, f"JOB {OUT} --bound-dense --vary seed=1,2", 2, ""),
    (compile_, f"JOB {OUT} --bound --vary seed=1,2", 2, ""),
    (compile_, "JOB --baseline sensorless --bound", 2, ""),
    (compile_, f"JOB --baseline sensorless {OUT}", 2, ""),
    (compile_, "JOB", 2, ""),
    (compile_, "", 2, ""),
    (evaluate, "none.msgpack", 3, "none"),
    (evaluate, "cut.msgpack", 3, ""),
    (evaluate, "bit.msgpack", 3, ""),
    (evaluate, "JOB", 3, "it is a job file: squeezetree plan"),
    (evaluate, "TABLE --world-set friction.finger_part_max", 2, ""),
    (evaluate, "TABLE --world-set friction.finger_part_mxa=1", 3, ""),
    (evaluate, "TABLE --world-set friction.finger_part_max=0.1", 3, ""),
    (evaluate, "TABLE --sweep --encoder-offset-mm 1", 2, ""),
    (evaluate, "TABLE --placement-error-mm -1", 2, ""),
    (evaluate, "TABLE --encoder-offset-mm nan", 2, ""),
    (evaluate, "TABLE --placement-bias-mm 1e7 0", 2, "beyond 1000"),
    (evaluate, "TABLE --placement-error-mm 1e8", 2, "beyond 1000"),
    (evaluate, "TABLE --trials 99999999999999999999", 2, "is more than 1000000000"),
    (evaluate, "TABLE --world-set goal.distance_mm=0.01", 2, "no world depends on it"),
    (evaluate, "TABLE --world-set seed=5", 2, "no world depends on it"),
    (evaluate, f"TABLE --world-set part.faces=either {CHIRAL}", 2, "leads to 2 parts"),
    (evaluate, "TABLE --resume study.json", 2, ""),
    (evaluate, "TABLE --ppm --sweep", 2, ""),
    (evaluate, "TABLE --ppm --resume TABLE", 2, ""),
    (report, "TABLE -o x.svg", 2, "what is written is a page"),
    (simulate, f"JOB --poses none.csv {CSV}", 3, "none"),
    (simulate, f"JOB --poses nan.csv {CSV}", 3, "line 3"),
    (simulate, f"JOB --poses two.csv {CSV}", 3, "theta_rad"),
    (simulate, f"JOB --poses far.csv {CSV}", 3, "pose 1: is beyond"),
    (compile_, f"paper.toml {OUT} --budget 9s", 2, "leave --budget out"),
    (simulate, f"JOB --poses in.csv {CSV} --nominal", 2, ""),
]


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with valid and invalid input files."""
    folder = tmp_path_factory.mktemp("desk")
    for name, change in BAD_JOBS.items():
        text = change(JOB.read_text())
        assert text != JOB.read_text()
        (folder / f"{name}.toml").write_text(text)
    data = bytearray(TABLE.read_bytes())
    (folder / "cut.msgpack").write_bytes(data[:-7])
    data[len(data) // 2] ^= 4
    (folder / "bit.msgpack").write_bytes(data)
    write_poses(folder / "in.csv", [(1, 2, 3)])
    write_poses(folder / "nan.csv", [(1, 2, 3), (1, "nan", 3)])
    (folder / "two.csv").write_text("x_mm,y_mm\n1,2\n")
    write_poses(folder / "far.csv", [(1e7, 2, 3)])
    (folder / "paper.toml").write_text(f'{JOB.read_text()}\n[search]\nmethod = "paper"\n')
    return folder


@pytest.mark.parametrize(("command", "words", "code", "message"), REFUSED)
def test_planner_command_bad_input_is_refused_and_writes_nothing(
    command, words, code, message, desk, monkeypatch
):
    monkeypatch.chdir(desk)
    before = sorted(desk.rglob("*"))
    files = {"JOB": JOB, "TABLE": TABLE}
    refused = called(command.main, *(files.get(word, word) for word in words.split()))
    assert (refused.code, refused.one_line) == (code, True), refused
    assert message in refused.err
    assert sorted(desk.rglob("*")) == before
