"""The planner's commands as a user types them, with wrong input too."""

import csv
import errno
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from planner.cli import compile as compile_
from planner.cli import evaluate, report, simulate
from runtime.table import load

ROOT = Path(__file__).parents[2]
COMMANDS = Path(sys.executable).parent
JOB = ROOT / "trees" / "rectangle" / "job.toml"
TABLE = ROOT / "trees" / "rectangle" / "rectangle.msgpack"
SHARED = ROOT.parent / "shared" / "data"


def inside(command, *arguments):
    """A command without a process of its own."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            code = command.main(list(map(str, arguments)))
        except SystemExit as end:
            code = end.code
    return code, out.getvalue(), err.getvalue()


def one_line(err):
    return err.count("\n") == 1 and "Traceback" not in err


@pytest.fixture
def quick(tmp_path):
    """The rectangle in a cell that is not doubted, with a rough search."""
    path = tmp_path / "quick.toml"
    text = JOB.read_text().replace("chance = 0.8", "chance = 0.0")
    path.write_text(text + "\n[search]\nparticles = 1500\n")
    return path


def test_evaluate_prints_the_promised_keys():
    code, out, _ = inside(evaluate, TABLE, "--trials", 500, "--json")
    figures = json.loads(out)
    assert code == 0
    assert figures["trials"] == 500
    names = {"success_rate", "success_ci95", "mean_squeezes", "max_squeezes", "reject_rate"}
    assert names <= set(figures)


def test_evaluate_looks_closely_at_one_world():
    code, out, _ = inside(
        evaluate, TABLE, "--trials", 4000, "--encoder-offset-mm", 2.5, "--json", "--worst", 2
    )
    figures = json.loads(out)
    assert code == 0
    assert figures["reject_rate"] > 0.02
    assert figures["reliability"]["leaves"] == len(figures["reliability"]["table"]) > 1
    assert len(figures["worst"]) <= 2
    assert sum(row["trials"] for row in figures["confusions"]) >= 4000 * figures["wrong_rate"] - 0.5


def test_the_world_may_be_another_one_than_the_tables():
    slippery = (
        "--world-set",
        "friction.finger_part_min=0.15",
        "--world-set",
        "friction.finger_part_max=0.25",
    )
    plain, other = (
        json.loads(inside(evaluate, TABLE, "--trials", 2000, "--json", *words)[1])
        for words in ((), slippery)
    )
    assert other["mean_squeezes"] < plain["mean_squeezes"] - 0.02
    code, out, _ = inside(evaluate, TABLE, "--trials", 300, *slippery, "--placement-error-mm", 0.5)
    assert code == 0
    assert "friction.finger_part_min=0.15" in out
    assert "placement_mm 0.5" in out


def test_evaluate_sweeps_a_standard_set_of_worlds():
    code, out, _ = inside(evaluate, TABLE, "--trials", 200, "--sweep", "--json")
    worlds = json.loads(out)["worlds"]
    assert code == 0
    assert worlds[0]["world"] == "as planned"
    assert worlds[0]["set"] == {}
    assert len({world["world"] for world in worlds}) == len(worlds) >= 14
    assert all(world["trials"] == 200 for world in worlds)


def test_evaluate_counts_wrong_answers_in_parts_per_million(tmp_path):
    kept = tmp_path / "study.json"
    for _ in range(2):  # the second has nothing left to do
        code, out, _ = inside(
            evaluate, TABLE, "--ppm", "--trials", 10_000, "--json", "--resume", kept
        )
        record = json.loads(out)
        assert code == 0
        assert record["parts"] == 10_000
        assert (
            record["wrong_ppm"]["low"]
            <= record["wrong_ppm"]["rate"]
            <= record["wrong_ppm"]["high"]
            < 5000
        )
        assert len(record["leaves"]) == len(load(TABLE).table.leaves)
    code, out, _ = inside(
        evaluate, TABLE, "--ppm", "--trials", 10_000, "--resume", kept, "--until", 0.001
    )
    assert code == 0
    assert "0.001 ppm" in out
    before = kept.read_bytes()
    code, _, err = inside(evaluate, TABLE, "--ppm", "--seed", 5, "--resume", kept)
    assert code == 3
    assert one_line(err)
    assert kept.read_bytes() == before
    for words in (
        ["--until", 5],
        ["--resume", kept],
        ["--ppm", "--sweep"],
        ["--ppm", "--resume", TABLE],
    ):
        code, _, err = inside(evaluate, TABLE, *words)
        assert code == 2
        assert one_line(err)


def test_bad_worlds_are_refused_in_one_line():
    for words, expected in [
        (("--world-set", "friction.finger_part_max"), 2),
        (("--world-set", "friction.finger_part_mxa=1"), 3),
        (("--world-set", "friction.finger_part_max=0.1"), 3),
        (("--sweep", "--encoder-offset-mm", "1"), 2),
    ]:
        code, _, err = inside(evaluate, TABLE, "--trials", 100, *words)
        assert code == expected
        assert one_line(err)
    assert inside(evaluate, TABLE, "--placement-error-mm", "-1")[0] == 2
    assert inside(evaluate, TABLE, "--encoder-offset-mm", "nan")[0] == 2


def test_compile_says_what_limits_the_plan(quick, tmp_path):
    code, out, _ = inside(
        compile_, quick, "-o", tmp_path / "out.msgpack", "--trials", 2000, "--json"
    )
    advice = json.loads(out)["advice"]
    assert code == 0
    assert {gain["source"] for gain in advice["gains"]} >= {"pressure", "friction", "encoder noise"}
    assert advice["failing"] == pytest.approx(1.0 - json.loads(out)["success_rate"])


def test_compile_proves_how_near_the_best_the_plan_is(quick, tmp_path):
    words = (
        quick,
        "-o",
        tmp_path / "out.msgpack",
        "--trials",
        2000,
        "--no-advice",
        "--bound",
        5000,
    )
    code, out, _ = inside(compile_, *words, "--json")
    figures = json.loads(out)
    assert code == 0
    assert figures["advice"] is None
    assert 2.0 < figures["squeezes_lower_bound"] < figures["mean_squeezes"]
    bound = figures["bound"]
    assert bound["squeezes"] == figures["squeezes_lower_bound"]
    assert bound["confidence"] == 0.95
    assert bound["leaf_confidence"] == 0.99
    assert bound["success_rate"] == pytest.approx(figures["success_ci95"][0], abs=1e-5)
    assert set(bound["terms"]) == {"leaves", "overall"}
    table = (tmp_path / "out.msgpack").read_bytes()
    code, out, _ = inside(compile_, *words)
    shown = float(re.search(r"any plan as good takes (\d\.\d\d) squeezes a part or more", out)[1])
    assert shown <= figures["squeezes_lower_bound"] < shown + 0.01
    assert (tmp_path / "out.msgpack").read_bytes() == table


def test_the_baseline_without_sensors_is_worse_than_any_plan(tmp_path):
    code, out, _ = inside(compile_, JOB, "--baseline", "sensorless", "--trials", 2000, "--json")
    figures = json.loads(out)
    assert code == 0
    assert len(figures["angles_deg"]) == figures["squeezes"] <= figures["most_squeezes"]
    assert figures["ideal"]["oriented"] > 0.98
    assert figures["real"]["located"] < 0.7  # the paper, footnote 2
    assert inside(compile_, JOB, "--baseline", "sensorless", "-o", tmp_path / "out.msgpack")[0] == 2
    assert inside(compile_, JOB)[0] == 2


def write_poses(path, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([("x_mm", "y_mm", "theta_rad"), *rows])


def read_rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_simulate_repeats_its_inputs_and_adds_the_results(tmp_path):
    write_poses(tmp_path / "in.csv", [(1, 2, 0.3), (100, 0, 0)])
    code, _, _ = inside(
        simulate,
        JOB,
        "--poses",
        tmp_path / "in.csv",
        "-o",
        tmp_path / "out.csv",
        "--nominal",
        "--mu",
        0.5,
    )
    rows = read_rows(tmp_path / "out.csv")
    assert code == 0
    assert [float(row["x_mm"]) for row in rows] == [1, 100]
    assert rows[0]["status"] in {"grasped", "jammed"}
    assert rows[1]["status"] == "untouched"
    assert float(rows[1]["final_x_mm"]) == 100
    assert float(rows[1]["width_mm"]) == 0


@pytest.mark.skipif(
    not SHARED.is_dir(), reason="reference data ../shared/data is not beside the checkout"
)
def test_simulate_reproduces_the_reference_squeezes(tmp_path):
    reference = read_rows(SHARED / "oracle_rect.csv")
    poses = [
        (1e3 * float(r["x0_m"]), 1e3 * float(r["y0_m"]), float(r["th0_rad"])) for r in reference
    ]
    write_poses(tmp_path / "in.csv", poses)
    inside(
        simulate,
        JOB,
        "--poses",
        tmp_path / "in.csv",
        "-o",
        tmp_path / "out.csv",
        "--nominal",
        "--mu",
        0.5,
    )
    for want, got in zip(reference, read_rows(tmp_path / "out.csv"), strict=True):
        dx = 1e3 * float(want["x_m"]) - float(got["final_x_mm"])
        dy = 1e3 * float(want["y_m"]) - float(got["final_y_mm"])
        turn = math.remainder(float(want["th_rad"]) - float(got["final_theta_rad"]), 2 * math.pi)
        assert math.hypot(dx, dy) < 0.5
        assert abs(math.degrees(turn)) < 2.0


BAD_JOBS = {
    "toml": lambda text: text.replace("[goal]", "[goal"),
    "key": lambda text: text.replace("distance_mm", "distance_mn"),
    "friction": lambda text: text.replace("finger_part_min = 0.4", "finger_part_min = 0.7"),
    "crossing": lambda text: text.replace("[30, 21], [0, 21]]", "[0, 21], [30, 21]]"),
    "large": lambda text: text.replace(
        "[[0, 0], [30, 0], [30, 21], [0, 21]]", "[[0,0],[99,0],[99,99],[0,99]]"
    ),
}


@pytest.mark.parametrize("name", BAD_JOBS)
def test_compile_of_a_bad_job_is_refused_in_one_line(tmp_path, name):
    bad = tmp_path / "bad.toml"
    bad.write_text(BAD_JOBS[name](JOB.read_text()))
    assert bad.read_text() != JOB.read_text()
    code, _, err = inside(compile_, bad, "-o", tmp_path / "out.msgpack")
    assert code == 3
    assert one_line(err)
    assert not (tmp_path / "out.msgpack").exists()


def test_an_unknown_key_is_answered_with_the_nearest_name(tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text(BAD_JOBS["key"](JOB.read_text()))
    assert "distance_mm" in inside(compile_, bad, "-o", tmp_path / "out.msgpack")[2]


def test_missing_files_and_folders_are_named(tmp_path):
    for expected, *arguments in (
        (3, compile_, tmp_path / "none.toml", "-o", tmp_path / "out.msgpack"),
        (2, compile_, JOB, "-o", tmp_path / "none" / "out.msgpack"),
        (3, evaluate, tmp_path / "none.msgpack"),
        (3, simulate, JOB, "--poses", tmp_path / "none.csv", "-o", tmp_path / "out.csv"),
    ):
        code, _, err = inside(*arguments)
        assert code == expected
        assert one_line(err)
        assert "none" in err


def test_bad_poses_name_their_line(tmp_path):
    write_poses(tmp_path / "in.csv", [(1, 2, 3), (1, "nan", 3)])
    code, _, err = inside(simulate, JOB, "--poses", tmp_path / "in.csv", "-o", tmp_path / "out.csv")
    assert code == 3
    assert "line 3" in err
    (tmp_path / "in.csv").write_text("x_mm,y_mm\n1,2\n")
    code, _, err = inside(simulate, JOB, "--poses", tmp_path / "in.csv", "-o", tmp_path / "out.csv")
    assert code == 3
    assert "theta_rad" in err


def test_usage_errors(tmp_path):
    write_poses(tmp_path / "in.csv", [(1, 2, 3)])
    files = ("--poses", tmp_path / "in.csv", "-o", tmp_path / "out.csv")
    assert inside(simulate, JOB, *files, "--nominal")[0] == 2
    assert inside(evaluate, TABLE, "--world", "no.such.module:make", "--trials", 1)[0] == 2
    assert inside(evaluate, TABLE, "--world", "math:sqrt2", "--trials", 1)[0] == 2
    assert inside(compile_)[0] == 2
    table = ("-o", tmp_path / "out.msgpack")
    for words in (
        (*table, "--bound", 0),
        (*table, "--bound", 10**9),
        (*table, "--bound-dense", "--vary", "seed=1,2"),
        (*table, "--bound", "--vary", "seed=1,2"),
        ("--baseline", "sensorless", "--bound"),
    ):
        code, _, err = inside(compile_, JOB, *words)
        assert (code, one_line(err)) == (2, True), words


def test_a_damaged_table_is_refused(tmp_path):
    data = bytearray(TABLE.read_bytes())
    (tmp_path / "cut.msgpack").write_bytes(data[:-7])
    data[len(data) // 2] ^= 4
    (tmp_path / "bit.msgpack").write_bytes(data)
    for name in ("cut", "bit"):
        code, _, err = inside(evaluate, tmp_path / f"{name}.msgpack")
        assert code == 3
        assert one_line(err)


def test_a_second_ctrl_c_in_the_middle_of_a_compile_leaves_nothing_behind(tmp_path):
    call = "import sys, planner.cli.compile as c; sys.exit(c.main())"
    words = [sys.executable, "-c", call, JOB, "-o", tmp_path / "out.msgpack", "--trials", "5000000"]
    process = subprocess.Popen(
        words, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while not process.stderr.readline().startswith(("search", "improve", "evaluate", "worlds")):
        assert process.poll() is None
    process.send_signal(
        signal.SIGINT
    )  # keeps the tree, if there is one: its five million trials take long
    time.sleep(5.0)  # two requests that wait for one kernel are one
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "plan-compile: interrupted; nothing was written"
    assert list(tmp_path.iterdir()) == []


def test_any_world_can_be_plugged_in(tmp_path):
    (tmp_path / "otherworld.py").write_text(
        "from planner.world import make as contact\n"
        "class Slow:\n"
        "    def __init__(self, job, seed): self.inner = contact(job, seed)\n"
        "    def squeeze(self, pose): return self.inner.squeeze(pose)\n"
        "def make(job, seed):\n"
        "    assert job.part.outline_mm.shape[1] == 2 and job.part.symmetry == 2\n"
        "    return Slow(job, seed)\n"
    )
    words = [COMMANDS / "plan-evaluate", str(TABLE), "--trials", "60", "--json"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*words, "--world", "otherworld:make"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert json.loads(done.stdout)["success_rate"] > 0.9


def test_a_full_disk_is_one_line_and_leaves_no_part_of_a_file(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    write_poses(tmp_path / "in.csv", [(1, 2, 0.3)])
    monkeypatch.setattr(os, "fsync", full)
    code, _, err = inside(simulate, JOB, "--poses", tmp_path / "in.csv", "-o", tmp_path / "out.csv")
    assert code == 2
    assert one_line(err)
    assert "out.csv" in err
    assert "free the disk" in err
    assert [path.name for path in tmp_path.iterdir()] == ["in.csv"]


def test_outputs_of_another_kind_are_refused_with_what_is_written(tmp_path):
    code, _, err = inside(compile_, JOB, "-o", tmp_path / "x.svg")
    assert (code, "what is written is a table" in err) == (2, True)
    code, _, err = inside(report, TABLE, "-o", tmp_path / "x.svg")
    assert (code, "what is written is a page" in err) == (2, True)
    code, _, err = inside(evaluate, JOB)
    assert (code, "it is a job file: squeezetree plan" in err) == (3, True)
