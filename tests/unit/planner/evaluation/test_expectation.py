"""Expected readings: histograms of all squeezes, in the bins of the runtime."""

from collections import Counter

import numpy as np
import pytest
from sample_tables import table_for

from planner.evaluation.cases import friction_cases
from planner.evaluation.evaluate import evaluate
from planner.evaluation.expectation import bins_of, expected, readings
from planner.evaluation.trials import encoder_of_table
from planner.work.scheduler import Threads
from planner.world import ContactWorlds
from runtime.table import PROFILES


@pytest.mark.parametrize("model", PROFILES)
def test_bins_of_steps_equal_bin_of_their_widths(model):
    table = table_for(model)
    steps = np.arange(table.gripper.steps + 1)
    widths_um = encoder_of_table(table).width_um(steps).tolist()
    assert bins_of(table, steps).tolist() == [table.gripper.bin_of(width) for width in widths_um]


def test_readings_count_every_squeeze_at_its_node(job, table):
    run = evaluate(table, job, ContactWorlds.of_job(job, 1), 300, 4)
    pairs = zip(run.path.ravel().tolist(), run.steps.ravel(), strict=True)
    counted = Counter((node, int(bins_of(table, step))) for node, step in pairs if node >= 0)
    result = readings(run, table)
    assert {(n, k): result[n, k] for n, k in np.argwhere(result).tolist()} == counted
    halves = [run.of_rows(np.arange(k, 300, 2)) for k in (0, 1)]
    np.testing.assert_array_equal(sum(readings(half, table) for half in halves), result)


def test_expected_worlds_are_the_friction_cases_the_planned_one_first(job, table):
    worlds = list(expected(table, job, 200, 4, Threads(1)))
    assert [world["name"] for world in worlds] == [case.name for case in friction_cases(job)]
    plain = readings(evaluate(table, job, ContactWorlds.of_job(job, 4), 200, 4), table)
    for world in worlds:
        assert sum(world["readings"][0].values()) == 200
        rows = np.zeros_like(plain)
        for row, counts in zip(rows, world["readings"], strict=True):
            row[[int(number) for number in counts]] = list(counts.values())
        assert np.array_equal(rows, plain) == (world is worlds[0])
