"""plan-expect: the expected readings at each node in several worlds, and a control chart that uses them."""

import json

import pytest
from drifting import Drift, parts, squeezed
from histories import watch
from rectangle import TABLE_PATH

from planner.cli import expect
from planner.evaluation import cases, expectation
from planner.job import model as job_file
from planner.work.scheduler import Threads
from runtime.spc.expectation import load as load_expectation
from runtime.spc.history import History
from runtime.table import load

pytestmark = pytest.mark.slow

LOADED = load(TABLE_PATH)
TABLE = LOADED.table
JOB = job_file.from_canonical(str(TABLE.job))
BEFORE, WITHIN = 200, 50
TRIALS = 30_000  # with fewer, chance in the expected readings raises false alarms


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The file that plan-expect writes."""
    path = tmp_path_factory.mktemp("expect") / "expected.json"
    assert expect.main([str(TABLE_PATH), "-o", str(path), "--trials", str(TRIALS)]) == 0
    return path


def test_expect_file_equals_the_expectation_of_its_seed_and_trials(written, tmp_path):
    assert len(load_expectation(written).names) == 1 + len(cases.FACTORS)
    record = json.loads(written.read_text())
    assert {sum(world["readings"][0].values()) for world in record["worlds"]} == {TRIALS}
    again = list(expectation.expected(TABLE, JOB, TRIALS, 0, Threads(1)))
    assert json.loads(json.dumps(again)) == record["worlds"]
    assert (record["table_sha256"], record["trials"], record["seed"]) == (LOADED.digest, TRIALS, 0)


@pytest.mark.parametrize("friction", [(0.05, 0.15), (0.8, 1.0)])
def test_readings_chart_alarms_only_after_a_change_of_friction(friction, written):
    drift = Drift(friction)
    before = list(parts(TABLE, squeezed(TABLE, JOB, BEFORE, 21), 21))
    after = list(parts(TABLE, squeezed(TABLE, JOB, WITHIN, 22, drift), 22, drift))
    result = watch(History(TABLE, (*before, *after)), load_expectation(written))
    assert all(alarm.place >= BEFORE for alarm in result)
    assert "readings" in {alarm.chart for alarm in result}
