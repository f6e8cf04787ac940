"""Plans made with a learned model."""

from pathlib import Path

import pytest

from planner.compile import compile_job
from planner.job import model as job_file
from planner.learned.model import learns
from planner.learned.store import Store
from runtime.table import dumps

JOB = Path(__file__).parents[2] / "trees" / "rectangle" / "job.toml"
SEARCH = {"model": "kcde", "rollouts": 10_000, "particles": 1000, "search_particles": 80}


def test_a_plan_made_with_the_learned_model_locates_the_part_and_repeats_without_its_store(
    tmp_path,
):
    job = job_file.load(JOB, {"search": SEARCH, "doubt": {"chance": 0.0}})
    store = Store(tmp_path)
    plan = compile_job(job, workers=2, trials=1000, store=store)
    figures = plan.evaluation.summary()
    assert figures["success_rate"] >= 0.97
    assert figures["mean_squeezes"] <= 3.5
    assert figures["crashes"] == 0
    again = compile_job(job, workers=1, trials=1000)
    assert dumps(again.table) == dumps(plan.table)


@pytest.mark.parametrize(
    ("model", "expected"), [("simulation", False), ("auto", False), ("kcde", True)]
)
def test_a_job_learns_where_it_says_so(model, expected):
    changes = {"search": {"model": model}, "actions": {"proposals": "belief"}}
    assert learns(job_file.load(JOB, changes)) == expected
