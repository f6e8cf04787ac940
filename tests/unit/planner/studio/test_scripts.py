"""The studio's scripts in Chromium: places in an animation, radii by keys, and that texts stay texts."""

import json

import pytest
from browser import NEEDED, value_of

FOLDER = "planner/studio/templates"
SCRIPTS = ["runtime/pages/elements.js", f"{FOLDER}/drawing.js", f"{FOLDER}/film.js"]
pytestmark = [NEEDED, pytest.mark.slow]


def pose(x_mm, y_mm, turn_deg):
    return {"x_mm": x_mm, "y_mm": y_mm, "turn_deg": turn_deg}


def corner(x_mm, y_mm):
    return {"x_mm": x_mm, "y_mm": y_mm}


SQUEEZES = [
    {
        "before": pose(1, 2, 170),
        "after": pose(1, 0, -170),
        "hand": pose(0, 0, 0),
        "opening_mm": 85,
        "width_mm": 21,
    },
    {
        "before": pose(0, 0, 0),
        "after": pose(0, 1, 0),
        "hand": pose(5, 6, 90),
        "opening_mm": 60,
        "width_mm": 22,
    },
]
FILM = {
    "outline": [corner(-15, -10.5), corner(15, -10.5), corner(15, 10.5), corner(-15, 10.5)],
    "reach_mm": 18.4,
    "hand": {"opening_mm": 85, "length_mm": 27.5, "width_mm": 9.5},
    "squeezes": SQUEEZES,
}
EXPRESSION = """{
  touch: [at(0, 0, 0), at(0, 0, 90), at(9, 2, 0)].map((pose) => touchWidth(film.outline, pose)),
  lasts: lasts(film),
  begins: momentOf(film, 0), touches: momentOf(film, 0.01), half: momentOf(film, 1.1),
  held: momentOf(film, 1.9),
  second: momentOf(film, 2), ends: momentOf(film, lasts(film)),
  radii: [nearestRadius(3.3), nearestRadius(-1), nearestRadius(1e9), radiusAfter("ArrowUp", 3, false),
    radiusAfter("ArrowLeft", 3, true), radiusAfter("End", 3, false), radiusAfter("Tab", 3, false)],
  caption: drawMoment(byId("view"), film, 4), fingers: byId("view").querySelectorAll(".finger").length,
  text: make("li", {title: evil}, evil).textContent, inside: make("li", {}, evil).children.length,
}"""
EVIL = '<img src=x onerror="document.title=1">Prüfling\'s "Ä"'


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    given = f"const film = {json.dumps(FILM)}, evil = {json.dumps(EVIL)};".replace("<", "\\u003c")
    given += "const at = (x_mm, y_mm, turn_deg) => ({x_mm, y_mm, turn_deg});"
    expression = f"(() => {{ {given} return {EXPRESSION} }})()"
    return value_of(expression, SCRIPTS, tmp_path_factory.mktemp("browser"))


def test_fingers_touch_where_the_outline_is_farthest_from_their_middle(seen):
    assert seen["touch"] == pytest.approx([21.0, 30.0, 25.0])


def test_a_film_begins_with_open_jaws_and_the_part_where_it_lay(seen):
    assert seen["lasts"] == 4
    assert (seen["begins"]["width"], seen["begins"]["part"]) == (85, SQUEEZES[0]["before"])
    assert seen["touches"]["part"] == SQUEEZES[0]["before"]  # untouched: not moved


def test_a_squeeze_ends_at_the_width_and_pose_that_were_read(seen):
    held = seen["held"]
    assert held["width"] == pytest.approx(21.0)
    assert (held["part"]["x_mm"], held["part"]["y_mm"]) == (1, 0)
    assert held["part"]["turn_deg"] == pytest.approx(190.0)  # the short way: -170 is 190
    assert 170.0 < seen["half"]["part"]["turn_deg"] < 190.0


def test_each_squeeze_has_its_hand_and_the_film_ends_with_the_last(seen):
    assert (seen["second"]["number"], seen["second"]["hand"]) == (1, SQUEEZES[1]["hand"])
    assert seen["ends"]["number"] == 1
    assert seen["caption"] == "Squeeze 2 of 2: 22.0 mm apart"
    assert seen["fingers"] == 2


def test_radii_keep_to_steps_and_bounds(seen):
    assert seen["radii"] == [3.5, 0.5, 100, 3.5, 0.5, 100, None]


def test_markup_in_names_is_text(seen):
    assert (seen["text"], seen["inside"]) == (EVIL, 0)
