"""Plans made with a learned model, and what is said about it."""

import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from problems import JAWS, rectangle

from planner.cli import compile as plan_compile
from planner.compile import compile_job
from planner.diagnosis.model_quality import quality
from planner.job import model as job_file
from planner.learned.model import learned_model, learns
from planner.learned.rollouts import COLLIDES
from planner.learned.store import Store
from planner.mechanics.simulator import Simulator
from planner.report import canvas, models, paper_figures
from runtime.table import dumps

JOB = Path(__file__).parents[2] / "trees" / "rectangle" / "job.toml"
SMALL = {
    "search": {"model": "kcde", "rollouts": 20_000, "particles": 2000, "search_particles": 200},
    "doubt": {"chance": 0.0},
}


@pytest.fixture(scope="module")
def job():
    return job_file.load(JOB, SMALL)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return Store(tmp_path_factory.mktemp("roll-outs"))


@pytest.fixture(scope="module")
def plan(job, store):
    return compile_job(job, workers=2, trials=3000, store=store)


def test_a_plan_made_with_the_learned_model_finds_the_part(plan):
    figures = plan.evaluation.summary()
    assert figures["success_rate"] >= 0.98
    assert figures["mean_squeezes"] <= 3.5
    assert figures["crashes"] == 0


def test_same_seed_gives_the_same_bytes_with_and_without_a_store_on_one_worker_and_two(job, plan):
    again = compile_job(job, workers=1, trials=3000)
    assert dumps(again.table) == dumps(plan.table)


@pytest.mark.parametrize(
    ("model", "expected"), [("simulation", False), ("auto", False), ("kcde", True)]
)
def test_a_job_learns_where_it_says_so(model, expected):
    changes = {"search": {"model": model}, "actions": {"proposals": "belief"}}
    assert learns(job_file.load(JOB, changes)) == expected


@pytest.fixture(scope="module")
def judged(job, store):
    model, rolled = learned_model(job, Simulator.of_job(job, 2), store)
    return quality(job, model, rolled), rolled


def test_the_report_judges_every_action_and_every_model(job, judged):
    report, rolled = judged
    assert len(report.actions) + report.in_collision == len(job.actions.angles_deg)
    assert all(0.0 < action.comparison.ratio < 2.0 for action in report.actions)
    assert all(0.0 <= action.simulated < 0.5 for action in report.actions)
    assert report.rollouts == len(rolled.initial)
    assert report.colliding == np.mean(rolled.status == COLLIDES)
    assert report.sensor.q95_mm < 0.2
    assert report.collision.free + report.collision.colliding == 100_000
    assert 0.0 < report.collision.miss_rate < 0.1
    assert 0.0 < report.collision.false_alarm_rate < 0.05
    assert report.subspaces.size.tolist() == np.bincount(report.label).tolist()
    assert len(report.label) == len(report.final) == np.count_nonzero(rolled.status != COLLIDES)


def compiled(tmp_path, *words):
    overrides = JOB.read_text(encoding="utf-8") + (
        "\n[search]\nrollouts = 5000\nparticles = 1000\nsearch_particles = 100\n"
    )
    (tmp_path / "job.toml").write_text(overrides, encoding="utf-8")
    table = tmp_path / "tree.msgpack"
    common = ["--trials", "200", "--no-cache", *words]
    return plan_compile.main([str(tmp_path / "job.toml"), "-o", str(table), *common])


def test_the_text_says_it_all_and_the_picture_shows_the_partition(judged, tmp_path):
    report, _ = judged
    picture = tmp_path / "tree.models.svg"
    shown = report.subspaces, report.label, report.final, rectangle(), JAWS, models.names(report)
    canvas.save(picture, lambda: paper_figures.subspaces(*shown))
    out = models.text(report)
    assert out.count(" deg: ") == 4
    for word in (
        "motion: ",
        "sensor: ",
        "collision detector, jaws fully open",
        "widths: free space",
    ):
        assert word in out
    panels = [e.get("id", "") for e in ET.parse(picture).iter("{http://www.w3.org/2000/svg}g")]
    assert {name for name in panels if name.startswith("subspace-")} == {
        f"subspace-{k}" for k in range(4)
    }


def test_the_command_says_it_in_json_and_draws_beside_the_table(tmp_path, capsys):
    assert compiled(tmp_path, "--json", "--models-report") == 0
    models = json.loads(capsys.readouterr().out)["models"]
    assert [round(math.degrees(a["theta_rad"])) for a in models["actions"]] == [0, 45, 90, 135]
    assert all(
        a["ratio"] == pytest.approx(a["model_mm"] / a["simulator_mm"]) for a in models["actions"]
    )
    assert models["collision"]["miss_rate"] < 0.1
    assert models["sensor"]["median_mm"] <= models["sensor"]["worst_mm"]
    assert [part["rollouts"] > 0 for part in models["subspaces"]] == [True] * 4
    assert models["picture"] == str(tmp_path / "tree.models.svg")
    assert json.loads((tmp_path / "tree.models.json").read_text()) == models
    assert (tmp_path / "tree.models.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_a_report_that_cannot_be_made_is_refused_before_the_work(tmp_path, capsys):
    assert compiled(tmp_path, "--models-report", str(tmp_path / "fig.txt")) == 2
    assert "must end in .png, .svg, .pdf" in capsys.readouterr().err
    assert compiled(tmp_path, "--models-report", str(tmp_path / "no" / "fig.svg")) == 2
    assert compiled(tmp_path, "--models-report", "--vary", "seed=1,2") == 2
    assert "leave it out with --vary" in capsys.readouterr().err
    assert not (tmp_path / "tree.msgpack").exists()
