"""Rows of the comparison, and the table they are shown in."""

from pathlib import Path

import pytest
from comparison import METHODS, Row, markdown, run

pytestmark = pytest.mark.slow

TREES = Path(__file__).parents[4] / "trees"
FIGURES = {
    "row": "3",
    "part": "rectangle",
    "materials": "foam-abs",
    "paper": 0.972,
    "method": "paper",
    "success_rate": 0.5,
    "success_ci95": [0.4, 0.6],
    "within_rate": 0.95,
    "within_ci95": [0.94, 0.96],
    "mean_squeezes": 4.0,
    "max_squeezes": 7,
    "wrong_rate": 0.01,
    "reject_rate": 0.0,
    "unresolved_rate": 0.49,
    "crashes": 0,
    "compile_seconds": 3.14,
    "nodes": 40,
}


def cells(line):
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_markdown_has_a_line_for_each_row_and_leaves_empty_columns_out():
    lines = markdown([FIGURES, {**FIGURES, "row": "4"}]).splitlines()
    assert len(lines) == 4
    assert len({len(cells(line)) for line in lines}) == 1
    assert cells(lines[0])[:4] == ["row", "part", "materials", "paper's robot"]
    assert "0.9500 (0.9400 to 0.9600)" in cells(lines[2])
    zoo = markdown([{**FIGURES, "paper": None, "materials": ""}]).splitlines()
    assert "materials" not in cells(zoo[0])
    assert "paper's robot" not in cells(zoo[0])


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
