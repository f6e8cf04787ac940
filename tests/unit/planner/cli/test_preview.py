"""The preview of a drawing, which the studio's page shows before planning."""

import json

import pytest

from planner.cli.preview import preview
from planner.job.drafts import opening_of


def vertices(text):
    return [tuple(map(float, pair.split(","))) for pair in text.split()]


def test_preview_drawing_is_centred_and_states_assumptions(plate):
    shown = preview([plate.name])
    assert shown["error"] is None
    assert set(vertices(shown["outline"])) == {(x, y) for x in (-15.0, 15.0) for y in (-10.5, 10.5)}
    assert (shown["symmetry"], shown["reach_mm"]) == (2, pytest.approx(18.31))
    datum = shown["datum"]
    assert (abs(datum["x_mm"]), abs(datum["y_mm"])) == (15.0, 10.5)
    assert shown["hand"]["opening_mm"] == opening_of(shown["gripper"])
    assert shown["rooms_mm"][shown["gripper"]] == pytest.approx(0.5 * 85.0 - 18.31, abs=0.1)
    assert any("1 mm" in line for line in shown["assumed"])
    json.dumps(shown)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["plate.csv", "--radius=x"], "'x' is not a number"),
        (["plate.csv", "--gripper=none"], "invalid choice"),
        (["gone.csv"], "cannot be read"),
        (["plate.csv", "--thickness=0.5"], "0.5 mm thin"),
        (["plate.csv", "--units=m"], "which no gripper takes"),
        (["plate.csv", "--contour=3"], "has no contour 3"),
        (["plate.csv", "--distance=-1"], "distance"),
    ],
)
def test_preview_invalid_input_returns_a_one_line_error(plate, words, reason):
    error = preview(words)["error"]
    assert reason in error
    assert "\n" not in error
