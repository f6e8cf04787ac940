"""Hands all about a part that tell it from itself, turned."""

from pathlib import Path

import numpy as np
import pytest

from planner.belief.observation import encoder_of
from planner.belief.transition import Simulation
from planner.job import model as job_file
from planner.mechanics.mixture import Mixture
from planner.search.actions import actions_of
from planner.search.telling import foremost, order, overlap

RATCHET = Path(__file__).parents[4] / "trees" / "ratchet" / "job.toml"


def job_of(corner_mm):
    """A small plate, one of whose corners is cut off."""
    outline = [[-2.0, -5.0], [2.0, -5.0], [2.0, 5.0 - corner_mm], [2.0 - corner_mm, 5.0], [-2.0, 5.0]]
    part = {"name": "plate", "outline_mm": outline, "symmetry": 1}
    return job_file.load(RATCHET).replaced(search={"method": "closed-loop"}, part=part)


def squeezing(job):
    """A model of a job's squeezes."""
    return Simulation(Mixture.of_job(job, 1, 1.6), encoder_of(job))


def test_readings_overlap_by_what_both_poses_have_and_noise_of_a_count_counts():
    same, apart, beside = [9, 9, 9, 9], [9, 9, 20, 20], [9, 9, 10, 10]
    found = overlap(np.array([same, apart, beside]))
    np.testing.assert_allclose(found, [1.0, 0.0, 0.5])


def test_overlap_is_that_of_histograms_counted_by_hand():
    reading = np.random.default_rng(1).integers(3, 12, (20, 24))
    for row, found in zip(reading, overlap(reading), strict=True):
        shares = [np.zeros(256), np.zeros(256)]
        for i, count in enumerate(row):
            for step, weight in ((-1, 0.25), (0, 0.5), (1, 0.25)):
                shares[i // 12][count + step] += weight / 12
        assert found == pytest.approx(sum(min(a, b) for a, b in zip(*shares, strict=True)))


def test_every_second_hand_is_the_one_left_that_tells_most_and_the_others_stay_in_turn():
    found = order(np.array([0.9, 0.5, 0.9, 0.1, 0.9, 0.9]))
    assert found.tolist() == [3, 0, 1, 2, 4, 5]


@pytest.mark.parametrize(("corner_mm", "moved"), [(0.3, True), (3.5, False)])
def test_only_where_few_hands_tell_are_these_tried_first(corner_mm, moved):
    job = job_of(corner_mm)
    even = actions_of(job)
    found = foremost(even, job, squeezing(job), np.random.default_rng(0))
    before, after = even.proposals[0].scattered, found.proposals[0].scattered
    assert (before.tolist() != after.tolist()) == moved
    assert sorted(before.tolist()) == sorted(after.tolist())
    assert found.proposals[0].relative is even.proposals[0].relative
    assert found.placements is even.placements
