"""Planning under a budget: which passes begin, which tree remains, and what progress says."""

from types import SimpleNamespace

import numpy as np
import pytest
from rectangle import JOB_PATH

from planner import planning
from planner.job import model as job_file
from planner.planning import REPAIRABLE, REPAIRS, Course, Cut, Rounds
from planner.problem import Problem
from planner.search.effort import PASSES
from planner.work.limit import Limit

TIMES_S = [100.0 * stage.work for stage in PASSES]
TRIALS = "the passes are over, and trials begin"


class Scripted:
    """A search whose passes take `TIMES_S` and locate every part."""

    def __init__(self):
        self.clock_s, self.ends_s, self.stage = 0.0, [], None

    def begin(self, stage, previous):
        self.stage = stage
        return SimpleNamespace(actions=["squeeze"], value=1.0)

    def grow(self, root, over, progress):
        self.clock_s += TIMES_S[len(self.ends_s)]
        self.ends_s.append(self.clock_s)
        return True

    def due(self, root):
        return []


@pytest.fixture
def scripted(monkeypatch):
    def stop(root, job):
        raise RuntimeError(TRIALS)

    search = Scripted()
    monkeypatch.setattr(planning, "Search", lambda *_: search)
    monkeypatch.setattr(planning, "lower", stop)
    monkeypatch.setattr(Rounds, "within", lambda rounds, *_: rounds)
    return search


@pytest.mark.parametrize("budget_s", [20.0, 40.0, 60.0, 80.0, 110.0, 130.0, np.inf])
def test_planned_budget_begins_the_passes_that_leave_time_for_repairs(scripted, budget_s):
    limit = Limit(budget_s, lambda: scripted.clock_s)
    with pytest.raises(RuntimeError, match=TRIALS):
        planning.planned(Problem.of(job_file.load(JOB_PATH), 1), limit, 100)
    passes_s = (1.0 - REPAIRS) * budget_s
    complete = len(scripted.ends_s) == len(PASSES)
    assert all(end_s <= passes_s for end_s in scripted.ends_s[1:])
    assert complete or scripted.ends_s[-1] + TIMES_S[len(scripted.ends_s)] > passes_s


@pytest.mark.parametrize(
    ("missing", "value", "explores", "repairs", "better"),
    [
        (0.5 * REPAIRABLE, 2.0, False, True, True),
        (0.5 * REPAIRABLE, 4.0, False, True, False),
        (2.0 * REPAIRABLE, 2.0, False, True, False),
        (0.5 * REPAIRABLE, 2.0, True, True, False),
        (0.5 * REPAIRABLE, 2.0, False, False, False),
    ],
    ids=["better", "of higher value", "too many missing", "exploring", "no time for repairs"],
)
def test_better_unfinished_pass_needs_a_lower_value_and_time_for_repairs(
    missing, value, explores, repairs, better
):
    """If repairs can finish the unfinished tree, it is better than the old tree if its value is lower.

    If repairs cannot finish it, or if the pass explores, it must locate more parts than the old tree. Here
    it cannot, since the old tree locates all parts.
    """
    new, root = SimpleNamespace(value=value), SimpleNamespace(value=3.0)
    search = SimpleNamespace(
        stage=PASSES[0]._replace(explores=explores),
        missing=lambda tree: missing if tree is new else 0.0,
        close=lambda tree: False,
    )
    assert planning._better(search, new, root, repairs=repairs) is better


def test_course_of_passes_and_rounds_never_falls_and_nears_one():
    said = []
    course = Course(lambda what, done, of: said.append(done / of))
    for number in range(len(PASSES)):
        for left in (1.0, 0.4, 0.7, 0.0):
            course.in_pass(number, left)
    for attempt in range(4):
        course.after_trials(attempt, 1.0)
        course.after_trials(attempt, 0.0)
    assert said == sorted(said)
    assert said[0] == 0.0
    assert 0.9 < said[-1] <= 1.0


@pytest.mark.parametrize(("asked", "by"), [(True, "request"), (False, "budget")])
def test_cut_line_names_the_cause_and_the_open_share(asked, by):
    line = Cut(asked, 0.0123).line()
    assert "\n" not in line
    assert by in line
    assert "1.23%" in line
