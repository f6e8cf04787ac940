"""The figures that a table states come from trials that were not used in planning."""

from dataclasses import replace

import numpy as np
import pytest
from programs import JOB, TABLE, document
from rectangle import quick_job

from planner import compile as planning
from planner import planning as course
from planner.cli import compile as compile_
from planner.cli import evaluate as evaluate_
from planner.evaluation.evaluate import evaluate
from planner.job import model as job_file
from planner.work.progress import silent
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime.table import PPM, dumps, load

QUICK = {"particles": 500}
TRIALS = 1000


@pytest.fixture
def seeds(monkeypatch):
    """A list to which every evaluation adds its seed."""
    used = []

    def recorded(*arguments, **named):
        used.append(arguments[4])
        return evaluate(*arguments, **named)

    for module in (planning, course):
        monkeypatch.setattr(module, "evaluate", recorded)
    return used


def test_compile_job_figures_come_from_seed_not_used_in_planning(seeds):
    job = job_file.load(JOB, {"search": QUICK, "seed": 4})
    plan = planning.compile_job(job, workers=2, trials=TRIALS)
    assert seeds.count(plan.seed) == 1
    # Trials in cells with doubt may follow, for leaves that no part reached.
    assert plan.seed in seeds[-2:]
    table = plan.table
    again = evaluate(table, job, ContactWorlds.of_job(job, plan.seed), TRIALS, plan.seed)
    assert again.summary() == plan.evaluation.summary()
    said, figures = table.predicted, again.summary()
    assert said.success_ppm == round(PPM * figures["success_rate"])
    assert said.mean_squeezes_ppm == round(PPM * figures["mean_squeezes"])
    assert said.reject_ppm == round(PPM * figures["reject_rate"])
    for index, leaf in enumerate(table.leaves):
        here = again.leaf == index
        if here.any():
            hits = int(np.sum(again.within[here]))
            assert (leaf.trials, leaf.success_ppm) == (here.sum(), round(PPM * hits / here.sum()))
    dumps(table)  # raises no error: no leaf contradicts its trials


def test_measured_refuted_leaf_is_unresolved_and_counts_as_failure(seeds):
    certain = {"friction": {"doubt": 0.0}, "doubt": {"chance": 0.0}, "part": {"tolerance_mm": 0.0}}
    job = job_file.load(JOB, certain)
    table = load(TABLE).table
    leaf = max(range(len(table.leaves)), key=lambda k: table.leaves[k].trials)
    rows = list(table.leaves)
    rows[leaf] = rows[leaf]._replace(x_um=rows[leaf].x_um + 50_000)
    table = replace(table, leaves=tuple(rows))
    plan = planning._measured(job, course.Planned(None, table, 0, TRIALS, None), Threads(2), silent)
    assert seeds == [plan.seed]
    assert not plan.table.leaves[leaf].resolved
    assert plan.table.leaves[leaf].success_ppm == 0
    assert np.all(plan.evaluation.unresolved[plan.evaluation.leaf == leaf])
    again = evaluate(plan.table, job, ContactWorlds.of_job(job, plan.seed), TRIALS, plan.seed)
    assert plan.table.predicted.success_ppm == round(PPM * again.summary()["success_rate"])
    dumps(plan.table)


def test_plan_evaluate_with_seed_of_plan_compile_repeats_its_figures(tmp_path):
    path = quick_job(tmp_path / "job.toml", "particles = 300")
    words = (tmp_path / "table.msgpack", "--trials", "500", "--json")
    said = document(compile_.main, path, "--no-advice", "-o", *words)
    seen = document(evaluate_.main, *words, "--seed", said["trials_seed"])
    names = ["success_rate", "wrong_rate", "reject_rate", "mean_squeezes", "crashes", "error_mm"]
    assert {name: said[name] for name in names} == {name: seen[name] for name in names}
