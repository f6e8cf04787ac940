"""Rows of the comparison, and the table they are shown in."""

from pathlib import Path

import pytest
from comparison import METHODS, Row, run

pytestmark = pytest.mark.slow

TREES = Path(__file__).parents[4] / "trees"


def test_a_row_is_compiled_for_the_job_and_judged_in_the_world():
    thin = ("search.particles=300", "search.search_particles=60")
    nominal = Row("a", "hex-nut", job=thin)
    # A world in which the upper finger alone closes: centred plans end millimetres off.
    other = Row("b", "hex-nut", job=thin, world=("gripper.upper_finger_share=0.9",))
    method = METHODS["fixed-actions"]
    figures = [run(row, method, TREES, 400, workers=2) for row in (nominal, other)]
    assert figures[0]["trials"] == 400
    assert figures[0]["nodes"] == figures[1]["nodes"]
    assert figures[0]["within_rate"] > 0.9 > figures[1]["within_rate"]
    assert figures[0]["within_rate"] >= figures[0]["success_rate"]
    assert figures[0]["compile_seconds"] > 0.0
