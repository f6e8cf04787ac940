"""What a page draws of a drawing before it is planned."""

import json
import subprocess
import sys

import pytest

from planner.cli.preview import preview
from planner.job.drafts import GRIPPERS

PLATE = "0,0\n30,0\n30,21\n0,21\n"


@pytest.fixture
def plate(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plate.csv").write_text(PLATE)
    return "plate.csv"


def vertices(text):
    return [tuple(map(float, pair.split(","))) for pair in text.split()]


def test_the_part_is_drawn_about_its_centre_with_what_would_be_assumed(plate):
    shown = preview([plate])
    assert shown["error"] is None
    assert set(vertices(shown["outline"])) == {(x, y) for x in (-15.0, 15.0) for y in (-10.5, 10.5)}
    assert (shown["symmetry"], shown["reach_mm"]) == (2, pytest.approx(18.31))
    datum = shown["datum"]
    assert (abs(datum["x_mm"]), abs(datum["y_mm"])) == (15.0, 10.5)
    assert shown["hand"]["opening_mm"] == GRIPPERS[shown["gripper"]].opening_mm
    assert shown["rooms_mm"][shown["gripper"]] == pytest.approx(0.5 * 85.0 - 18.31, abs=0.1)
    assert any("1 mm" in line for line in shown["assumed"])
    json.dumps(shown)


def test_stated_settings_are_taken(plate):
    shown = preview(
        [plate, "--units=cm", "--gripper=robotiq-2f-140", "--radius=3", "--thickness=4"]
    )
    assert (shown["gripper"], shown["radius_mm"], shown["height_mm"]) == (
        "robotiq-2f-140",
        3.0,
        4.0,
    )
    assert shown["contours"][0]["width_mm"] == 300.0


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
def test_what_is_refused_says_why_in_one_line(plate, words, reason):
    error = preview(words)["error"]
    assert reason in error
    assert "\n" not in error


def test_contours_are_shown_where_the_one_that_is_asked_for_is_refused(plate):
    assert [contour["number"] for contour in preview([plate, "--contour=3"])["contours"]] == [1]


def test_as_a_program_it_answers_a_line_with_a_line(plate):
    done = subprocess.run(
        [sys.executable, "-m", "planner.cli.preview"],
        input='["plate.csv"]\n["gone.csv"]\n',
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    first, second = map(json.loads, done.stdout.splitlines())
    assert first["error"] is None
    assert "gone.csv" in second["error"]
