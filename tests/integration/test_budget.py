"""plan-compile under a budget or interrupted keeps the best tree so far and states that it was cut short."""

import json
import signal
import sys

import pytest
from programs import JOB, ended, started
from rectangle import CERTAIN, quick_job
from refusals import refused_in_a_line

from planner.cli import compile as plan_compile
from planner.compile import compile_job
from planner.errors import NoPlanError
from planner.job import model as job_file
from planner.planning import LEAST_TRIALS
from planner.search import search
from planner.work.limit import Limit
from runtime.table import dumps, load, loads

WAITING = """
import sys, time
from planner.cli import compile
from planner.search.effort import PASSES
from planner.search.search import Search

grow = Search.grow

def growing(search, root, over, progress):
    if search.stage is PASSES[0]:
        return grow(search, root, over, progress)
    print("improving", file=sys.stderr, flush=True)
    grow(search, root, lambda: True, progress)
    while not over():
        time.sleep(0.01)
    return False

Search.grow = growing
sys.exit(compile.main(sys.argv[1:]))
"""

LOADING = """
import gc, sys
from numba.core.dispatcher import Dispatcher
from planner.compile import compile_job
from planner.job import model
from planner.work.limit import Limit

class Budget(Limit):
    def start(self):
        self.before = loaded()
        super().start()

def loaded():
    kernels = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {(one.py_func.__qualname__, str(each)) for one in kernels for each in one.signatures}

limit = Budget(600.0)
compile_job(model.load(sys.argv[1]), 2, 1000, limit=limit)
print(sorted(name for name, _ in loaded() - limit.before))
"""


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """The rectangle without doubt about the cell, planned with few particles."""
    folder = tmp_path_factory.mktemp("job")
    return quick_job(folder / "job.toml", "particles = 500", *CERTAIN)


class Steps:
    """A clock that advances by a second at each reading."""

    now = 0.0

    def __call__(self):
        self.now += 1.0
        return self.now


@pytest.fixture(scope="module")
def whole(job):
    clock = Steps()
    plan = compile_job(job_file.load(job), 2, 1000, limit=Limit(1e9, clock))
    return plan, clock.now


@pytest.mark.parametrize("share", [0.4, 0.8])
def test_compile_job_spent_budget_returns_whole_tree_and_open_share(job, whole, share):
    """A search with only a share of the time it needs is cut short, but the tree of its plan is whole."""
    assert whole[0].cut is None
    plan = compile_job(job_file.load(job), 2, 1000, limit=Limit(share * whole[1], Steps()))
    assert loads(dumps(plan.table)) == plan.table
    assert LEAST_TRIALS <= plan.table.predicted.trials <= 1000
    assert plan.cut is not None
    assert plan.cut.open_share == pytest.approx(plan.evaluation.unresolved.mean())
    assert plan.evaluation.success.mean() >= 0.95 or plan.cut.open_share > 0.0


@pytest.mark.timeout(600)
def test_compile_job_budget_starts_after_kernels_are_loaded(job):
    """Compiling the kernels takes half a minute, more than the budget of many a first plan."""
    _, out, err = ended([sys.executable, "-c", LOADING, job], timeout=None)
    assert out == "[]\n", err


def test_compile_job_goal_finer_than_readings_is_refused_in_one_line(monkeypatch):
    """For so fine a goal, the search would go on to the limit of nodes; a lower limit ends it early here."""
    monkeypatch.setattr(search, "MOST_NODES", 40)
    rectangle = job_file.load(JOB)
    fine = rectangle.replaced(goal={"distance_mm": 0.02}, search={"particles": 4000})
    with refused_in_a_line(NoPlanError, "% of the parts are outside the goal after"):
        compile_job(fine, 2, 500)


def test_compile_job_zero_budget_is_refused_without_advice_on_actions(job):
    with pytest.raises(NoPlanError, match="CUT SHORT by the budget") as caught:
        compile_job(job_file.load(job), 2, 500, limit=Limit(1e-9))
    assert "add actions" not in str(caught.value)


def test_plan_compile_spent_budget_is_stated_in_text_and_json(job, tmp_path, capsys, monkeypatch):
    class Stingy(Limit):
        """A limit that is spent at its 21st check, whatever the time."""

        looks = 0

        def over(self, kept_s=0.0):
            self.looks += 1
            return self.looks > 20

    monkeypatch.setattr(plan_compile, "Limit", Stingy)
    words = [str(job), "-o", str(tmp_path / "t.msgpack"), "--trials", "300", "--budget", "60min"]
    assert plan_compile.main(words) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("CUT SHORT by the budget: ")
    assert out[0].endswith("how long the rest of it takes is not known")
    assert not any("add angles" in line or "max_depth" in line for line in out)
    assert plan_compile.main([*words, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["cut_short"]["by"] == "budget"
    assert record["cut_short"]["open_share"] == pytest.approx(record["unresolved_rate"], abs=1e-6)
    assert record["cut_short"]["seconds_to_finish"] is None
    assert record["advice"] is None


def interrupted(job, output, *options):
    """Starts plan-compile, and sends it one Ctrl-C once its tree is grown; returns the process.

    The process has then reported that it is stopping.
    """
    process = started([sys.executable, "-c", WAITING, job, "-o", output, *options])
    assert any(line == "improving\n" for line in process.stderr)
    process.send_signal(signal.SIGINT)
    heard = process.stderr.readline()
    assert "stopping" in heard, heard + process.stderr.read()
    return process


def test_plan_compile_ctrl_c_writes_current_tree_and_exits_130(job, tmp_path):
    output = tmp_path / "t.msgpack"
    process = interrupted(job, output, "--trials", "1000")
    out, err = process.communicate(timeout=120)
    assert process.returncode == 130
    assert out.startswith("CUT SHORT by request: "), err
    assert load(output).table.predicted.success_ppm > 0


def test_plan_compile_second_ctrl_c_writes_nothing_and_exits_130(job, tmp_path):
    process = interrupted(job, tmp_path / "t.msgpack", "--trials", "1000000")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert err.splitlines()[-1] == "plan-compile: interrupted; nothing was written"
    assert list(tmp_path.iterdir()) == []


def test_plan_compile_interrupted_advice_still_writes_table(job, tmp_path, capsys, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(plan_compile, "counsel", interrupt)
    output = tmp_path / "t.msgpack"
    assert plan_compile.main([str(job), "-o", str(output), "--trials", "200"]) == 0
    out, err = capsys.readouterr()
    assert f"wrote {output}" in out
    assert f"interrupted: no advice; {output} is written" in err
    assert load(output).table.predicted.trials == 200
