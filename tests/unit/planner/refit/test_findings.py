"""What a posterior of cells says to people, and what it changes in the job."""

from types import SimpleNamespace

import numpy as np
import pytest
from rectangle import JOB_PATH

from planner.job.model import load
from planner.refit.cells import Space
from planner.refit.findings import changes, findings
from planner.refit.posterior import Posterior

JOB = load(JOB_PATH).replaced(doubt={"least_dof": 5})


def posterior_of(**intervals: tuple[float, float]) -> Posterior:
    """A posterior in which the named quantities are uniform in intervals, and the others as in the prior."""
    rng, space = np.random.default_rng(4), Space.of(JOB, 1)
    ends = [intervals.get(each.key, (each.low, each.high)) for each in space.quantities]
    columns = [rng.uniform(low, high, 4000) for low, high in ends]
    return Posterior(np.column_stack([*columns, np.zeros(4000)]), space)


def finding_of(posterior: Posterior, key: str):
    """The finding about a quantity."""
    every = findings(posterior, SimpleNamespace(job=JOB))
    return next(finding for finding in every if finding.quantity == key)


def test_findings_prior_alone_learns_nothing_and_keeps_the_job():
    posterior = posterior_of(finger_part_min=(0.0, 2.0), finger_part_max=(0.0, 2.0))
    assert not any(finding.learned for finding in findings(posterior, SimpleNamespace(job=JOB)))
    assert changes(posterior, SimpleNamespace(job=JOB)) == {}


def test_finding_of_least_dof_is_in_degrees_of_freedom():
    posterior = posterior_of(least_dof=(np.log(8.0), np.log(9.0)))
    finding = finding_of(posterior, "least_dof")
    assert finding.learned
    assert 8.0 < finding.low_5 < finding.mean < finding.high_95 < 9.0
    assert finding.mean == pytest.approx(np.sqrt(72.0), rel=0.01)
    assert "by 8 to 9 degrees of freedom" in finding.sentence
    assert changes(posterior, SimpleNamespace(job=JOB))["doubt"] == {"least_dof": 8}


def test_finding_of_an_encoder_offset_is_its_90_percent_interval():
    posterior = posterior_of(encoder_mm=(0.30, 0.34))
    finding = finding_of(posterior, "encoder_mm")
    assert finding.learned
    assert (finding.low_5, finding.high_95) == pytest.approx((0.302, 0.338), abs=5e-4)
    assert changes(posterior, SimpleNamespace(job=JOB))["doubt"]["encoder_mm"] == pytest.approx(
        [0.302, 0.338], abs=1e-3
    )
