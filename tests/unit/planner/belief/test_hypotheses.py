"""Beliefs over several parts: distances and modes agree with slow reference versions.

Squeezes give the same results as with each part alone.
"""

import numpy as np
import pytest
from programs import TREES

from planner.belief.doubts import believed
from planner.belief.metric import Metric
from planner.frames import wrap
from planner.job import model as job_file
from planner.mechanics.mixture import Mixture
from planner.mechanics.simulator import Simulator
from planner.mechanics.traits import as_planned

GUSSET = TREES / "gusset" / "job.toml"
ORDERS, RHOS = (1, 2, 6), (10.0, 8.0, 12.0)


def metric(identify=True, kind="pose"):
    further = tuple(zip(RHOS[1:], ORDERS[1:], strict=True))
    return Metric(3.0, RHOS[0], ORDERS[0], kind, further=further, identify=identify)


def states(rng, n):
    poses = rng.normal(size=(n, 3)) * [2.0, 2.0, 0.3]
    return np.column_stack([poses, rng.integers(0, 3, n)])


def distance(state, reference, identify):
    """Slow reference version of `Metric.between`, for one state."""
    k = int(state[3])
    if identify and k != int(reference[3]):
        return np.inf
    turn = abs(float(wrap(state[2] - reference[2], ORDERS[k])))
    return float(np.hypot(*(state[:2] - reference[:2]))) + RHOS[k] * turn


@pytest.mark.parametrize("identify", [True, False])
def test_between_uses_the_symmetry_of_each_hypothesis(identify):
    result, reference = states(np.random.default_rng(1), 200), np.array([0.5, 0.0, 2.0, 1.0])
    slow = [distance(state, reference, identify) for state in result]
    np.testing.assert_allclose(metric(identify).between(result, reference), slow)


@pytest.mark.parametrize("identify", [True, False])
def test_mode_ratio_is_exact_and_near_the_largest(identify):
    result = states(np.random.default_rng(2), 300)
    mode = metric(identify).mode(result)
    shares = [
        np.mean([distance(s, r, identify) < 3.0 for s in result]) for r in (mode.state, *result)
    ]
    assert mode.ratio == pytest.approx(shares[0])
    # The search for the mode starts from some states only.
    assert mode.ratio >= max(shares[1:]) - 0.02
    assert mode.hypothesis[0] == int(mode.state[3])


@pytest.fixture(scope="module")
def job():
    return job_file.load(GUSSET, {"part": {"faces": "either"}})


def test_believed_two_faces_are_drawn_by_their_shares(job):
    belief = believed(job, 2000, np.random.default_rng(6))
    assert belief.traits["hypothesis"].mean() == pytest.approx(0.5, abs=0.05)


def test_squeeze_of_mixture_treats_each_hypothesis_as_its_part(job):
    traits = as_planned(40)
    traits["hypothesis"] = np.arange(40) % 2
    poses = np.random.default_rng(7).uniform(-6.0, 6.0, (40, 3))
    mixed = Mixture.of_job(job, 1).squeeze(poses, np.random.default_rng(8), traits)
    rng = np.random.default_rng(8)
    for k, alone in enumerate(job.alone):
        rows = traits["hypothesis"] == k
        ours = Simulator.of_job(alone, 1).squeeze(poses[rows], rng, traits[rows])
        np.testing.assert_array_equal(mixed.poses[rows], ours.poses)
        np.testing.assert_array_equal(mixed.width_mm[rows], ours.width_mm)
