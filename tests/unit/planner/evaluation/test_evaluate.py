"""Evaluations do not depend on the number of workers, and meet the same parts in every world."""

import math
from dataclasses import fields

import numpy as np

from planner.evaluation.cases import standard_cases
from planner.evaluation.evaluate import evaluate, sweep
from planner.evaluation.outcome import Evaluation
from planner.work.scheduler import Threads
from planner.world import ContactWorlds


def worlds(real):
    return ContactWorlds.of_job(real, 5)


def same(a: Evaluation, b: Evaluation) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(Evaluation))


def test_evaluate_same_seed_and_other_workers_is_identical(job, table):
    runs = [
        evaluate(table, job, ContactWorlds.of_job(job, 1), 2300, 2, Threads(workers))
        for workers in (1, 2)
    ]
    assert same(runs[0], runs[1])
    assert len(runs[0].leaf) == 2300
    assert not same(runs[0], evaluate(table, job, ContactWorlds.of_job(job, 1), 2300, 3))


def test_sweep_cases_differ_in_the_world_only(job, table):
    cases = [case for case in standard_cases(job) if case.name in ("as planned", "encoder +1 mm")]
    plain, moved = sweep(table, job, cases, 1000, 3, worlds=worlds)
    assert np.array_equal(plain.evaluation.initial, moved.evaluation.initial)
    assert np.array_equal(plain.evaluation.poses, evaluate(table, job, worlds(job), 1000, 3).poses)
    shift = 1.0 / job.gripper.resolution_mm
    shifts = plain.evaluation.steps[:, 0] - moved.evaluation.steps[:, 0]
    assert set(np.unique(shifts)) <= {math.floor(shift), math.ceil(shift)}
