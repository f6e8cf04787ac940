"""Plans made with a learned model."""

from pathlib import Path

import pytest

from planner.compile import compile_job
from planner.job import model as job_file
from planner.learned.model import learns
from planner.learned.store import Store
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
