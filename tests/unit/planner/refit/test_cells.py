from pathlib import Path

import numpy as np
import pytest

from planner.job import model
from planner.refit.cells import Space

JOB = Path(__file__).parents[4] / "trees" / "rectangle" / "job.toml"


@pytest.fixture(scope="module")
def job():
    doubt = {"encoder_mm": [-3.0, 0.0], "encoder_gain": [0.0, 0.01], "finger_share": [0.0, 0.0]}
    return model.load(JOB, {"doubt": doubt})


def test_a_space_holds_what_the_job_doubts_and_no_less_than_is_usual(job):
    ranges = {
        quantity.key: (quantity.low, quantity.high) for quantity in Space.of(job, 1).quantities
    }
    assert ranges["encoder_mm"] == (-3.0, 1.5)
    assert ranges["encoder_gain"] == (0.0, 0.01)
    assert ranges["finger_share"] == (-0.1, 0.1)
    assert "least_dof" not in ranges


def test_every_cell_drawn_is_possible_and_others_are_not(job):
    space = Space.of(job, 4)
    points = space.draw(2000, np.random.default_rng(1))
    assert (space.density(points) > 0.0).all()
    assert set(points[:, -1]) == {0.0, 1.0, 2.0, 3.0}
    assert np.mean(points[:, -1] == 0.0) == pytest.approx(0.5, abs=0.05)
    low, high = space.column("finger_part_min"), space.column("finger_part_max")
    turned = points.copy()
    turned[:, [low, high]] = points[:, [high, low]] + [1e-6, 0.0]
    assert (space.density(turned) == 0.0).all()
    assert (space.density(points + 100.0 * np.eye(points.shape[1])[0]) == 0.0).all()
