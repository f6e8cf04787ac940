"""Advice on plans whose weakness is known, such as a coarse encoder or thin margins."""

from dataclasses import replace

import pytest

from planner.diagnosis.advice import advise, gains_without_noise
from planner.diagnosis.margins import THIN, Margins, margins_of
from planner.evaluation.cases import EVERYTHING, OFFSET
from planner.evaluation.evaluate import evaluate
from planner.world import ContactWorlds

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def evaluation(table, job):
    return evaluate(table, job, ContactWorlds.of_job(job, 1), 2000, 2)


def test_gains_without_noise_coarse_encoder_names_encoder_noise_first(table, job):
    coarse = job.replaced(gripper={"noise_mm": 1.2})
    gains = gains_without_noise(table, coarse, 2000)
    assert gains[0].source == "encoder noise"
    assert gains[0].certain
    assert gains[0].gain > 0.02
    assert gains[-1].source == EVERYTHING
    assert gains[-1].success_rate >= gains[0].success_rate - 0.01
    evaluation = evaluate(table, coarse, ContactWorlds.of_job(coarse, 1), 2000, 2)
    lines = advise(table, evaluation, coarse, gains).lines()
    assert any("encoder noise" in line for line in lines)


def test_advise_names_only_thin_margins(table, job, evaluation):
    enough = margins_of(table, evaluation, job, 2000)
    thin = Margins(OFFSET, THIN + 0.01, 0.3)
    for margins, expected in ((enough, False), (thin, True)):
        lines = advise(table, evaluation, job, margins=margins).lines()
        assert margins.thin == expected
        assert any("thin margins" in line for line in lines) == expected


def test_margins_of_leaves_turned_by_40_degrees_has_mostly_wrong_answers(table, job, evaluation):
    leaves = (leaf._replace(theta_urad=leaf.theta_urad + 700_000) for leaf in table.leaves)
    turned = replace(table, leaves=tuple(leaves))
    assert margins_of(turned, evaluation, job, 500).wrong_rate > 0.9
