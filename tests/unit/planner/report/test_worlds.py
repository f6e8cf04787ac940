"""The report states the compiler's figures; figures of another world are the same in all places."""

import re

import pytest
from rectangle import JOB_PATH

from planner.compile import compile_job
from planner.evaluation.shares import in_percent, shares_of
from planner.job import model as job_file
from planner.report import dossier, worlds
from planner.report.leaf_poses import WORTH_TELLING_MM, means
from planner.report.verdict import weakest
from planner.work.limit import Limit
from runtime.table import dumps, predicted_pose


@pytest.fixture(scope="module")
def planned():
    job = job_file.load(JOB_PATH).replaced(search={"particles": 1000})
    return job, compile_job(job, trials=1500)


@pytest.fixture(scope="module")
def page(planned):
    job, plan = planned
    return dossier.page(plan.table, job, dossier.Source("t.msgpack", dumps(plan.table)), 600)


def test_evaluation_of_table_equals_that_of_the_compiler(planned):
    job, plan = planned
    result = worlds.evaluation_of(plan.table, job, 7)
    assert result.summary() == plan.evaluation.summary()
    (line, *others) = worlds.tried(plan.table, job, plan.evaluation, 100)
    assert line.evaluation is plan.evaluation
    assert len({other.case.name for other in others}) == len(others)


def test_tried_beyond_its_limit_leaves_out_worlds_that_untried_names(planned):
    job, plan = planned
    now = iter(range(100)).__next__
    lines = worlds.tried(plan.table, job, plan.evaluation, 100, limit=Limit(3.5, clock=now))
    every = worlds.tried(plan.table, job, plan.evaluation, 100)
    assert 2 <= len(lines) < len(every)
    assert [line.case for line in lines] == [line.case for line in every[: len(lines)]]
    assert worlds.untried(job, lines) == [line.case.name for line in every[len(lines) :]]
    assert worlds.untried(job, every) == []


def test_page_cards_verdict_and_first_row_state_the_compilers_figures(planned, page):
    _, plan = planned
    figures = plan.evaluation.summary()
    shares = [in_percent(share) for share in shares_of(figures)]
    cards = dict(re.findall(r"<dt>([^<]+)</dt><dd>([^<:]+)", page))
    assert [cards[name] for name in ("Located", "wrong", "unresolved", "rejected")] == shares[:4]
    assert f"of {figures['trials']} trials" in page
    assert f"{shares[0]} of trials" in page
    row = re.search(r'<th scope="row">as the job says.*?</tr>', page, re.DOTALL)[0]
    cells = re.findall(r"<td>([^<]*)</td>", row)
    assert [cells[0], *cells[2:6]] == shares


def test_means_equal_the_mean_poses_and_stand_on_the_page(planned, page):
    _, plan = planned
    result = means(plan.table, plan.evaluation)
    for index, (leaf, mean) in enumerate(zip(plan.table.leaves, result, strict=True)):
        here = plan.evaluation.poses[plan.evaluation.leaf == index]
        if mean is None:
            continue
        x, y, _ = predicted_pose(leaf)
        assert mean.x_mm - x == pytest.approx((here[:, 0] - x).mean(), abs=0.5)
        assert mean.y_mm - y == pytest.approx((here[:, 1] - y).mean(), abs=0.5)
        assert mean.deliberate == (mean.apart_mm > WORTH_TELLING_MM)
    assert any(result)
    apart = next(mean for mean in result if mean)
    assert f"<td>{apart.apart_mm:.2f}</td>" in page
    assert ("this is deliberate" in page) == any(mean.deliberate for mean in result if mean)


def test_page_worst_world_agrees_in_headline_row_and_card(planned, page):
    job, plan = planned
    worst = weakest(worlds.tried(plan.table, job, plan.evaluation, 600))
    assert f"{worst.name} (" in page
    row = re.search(
        rf'<th scope="row">{re.escape(worst.name)} <strong>\(worst\).*?</tr>', page, re.DOTALL
    )[0]
    wrong = re.findall(r"<td>([^<]*)</td>", row)[2]
    assert f"<dt>worst other world</dt><dd>{wrong} wrong where" in page
