"""The studio's scripts in Chromium: the film and its player, radii set by keys, texts, and the page."""

import fcntl
import json
import re
from contextlib import closing

import pytest
from browser import NEEDED, ROOT, played, value_of

from planner.cli.preview import preview
from planner.studio.answers import Answers
from planner.studio.folder import Folder

FOLDER = "planner/studio/templates"
SCRIPTS = ["runtime/pages/elements.js", f"{FOLDER}/drawing.js", f"{FOLDER}/film.js"]
pytestmark = [NEEDED, pytest.mark.slow]


def pose(x_mm, y_mm, turn_deg):
    return {"x_mm": x_mm, "y_mm": y_mm, "turn_deg": turn_deg}


def corner(x_mm, y_mm):
    return {"x_mm": x_mm, "y_mm": y_mm}


def squeeze(before, after, **rest):
    return {"before": before, "after": after, **rest}


SQUEEZES = [
    squeeze(pose(1, 2, 170), pose(1, 0, -170), hand=pose(0, 0, 0), opening_mm=85, width_mm=21),
    squeeze(pose(0, 0, 0), pose(0, 1, 0), hand=pose(5, 6, 90), opening_mm=60, width_mm=22),
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
  player: (() => {
    const slider = make("input", {type: "range", min: 0, max: 4, step: 1, value: 4});
    const button = make("button"), seen = [];
    const {play} = player({slider, button, step: 1, milliseconds: 1e6, show: (now) => seen.push(now)});
    play();
    const begun = [button.textContent, slider.value];
    slider.value = 3;
    slider.dispatchEvent(new Event("input"));
    return {begun, ended: button.textContent, seen};
  })(),
  caption: drawMoment(byId("view"), film, 4), fingers: byId("view").querySelectorAll(".finger").length,
  text: make("li", {title: evil}, evil).textContent, inside: make("li", {}, evil).children.length,
}"""
EVIL = '<img src=x onerror="document.title=1">Prüfling\'s "Ä"'


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """What the browser returns for `EXPRESSION`: results of the film's and the player's functions."""
    given = f"const film = {json.dumps(FILM)}, evil = {json.dumps(EVIL)};".replace("<", "\\u003c")
    given += "const at = (x_mm, y_mm, turn_deg) => ({x_mm, y_mm, turn_deg});"
    expression = f"(() => {{ {given} return {EXPRESSION} }})()"
    return value_of(expression, SCRIPTS, tmp_path_factory.mktemp("browser"))


def test_touch_width_is_twice_the_farthest_distance_of_the_outline(seen):
    assert seen["touch"] == pytest.approx([21.0, 30.0, 25.0])


def test_moment_of_start_has_open_jaws_and_the_part_where_it_lay(seen):
    assert seen["lasts"] == 4
    assert (seen["begins"]["width"], seen["begins"]["part"]) == (85, SQUEEZES[0]["before"])
    assert seen["touches"]["part"] == SQUEEZES[0]["before"]  # not touched yet


def test_moment_of_held_part_has_the_width_and_pose_of_the_log(seen):
    held = seen["held"]
    assert held["width"] == pytest.approx(21.0)
    assert (held["part"]["x_mm"], held["part"]["y_mm"]) == (1, 0)
    assert held["part"]["turn_deg"] == pytest.approx(190.0)  # that is -170, by the short way
    assert 170.0 < seen["half"]["part"]["turn_deg"] < 190.0


def test_moment_of_later_squeeze_has_its_hand_and_the_last_ends_the_film(seen):
    assert (seen["second"]["number"], seen["second"]["hand"]) == (1, SQUEEZES[1]["hand"])
    assert seen["ends"]["number"] == 1
    assert seen["caption"] == "Squeeze 2 of 2: 22.0 mm apart"
    assert seen["fingers"] == 2


def test_player_restarts_after_the_end_and_pauses_when_the_slider_moves(seen):
    assert seen["player"] == {"begun": ["Pause", "0"], "ended": "Play", "seen": [3]}


def test_nearest_radius_and_radius_after_keep_to_steps_and_bounds(seen):
    assert seen["radii"] == [3.5, 0.5, 100, 3.5, 0.5, 100, None]


def test_make_markup_in_a_name_is_text(seen):
    assert (seen["text"], seen["inside"]) == (EVIL, 0)


def page_with(answers):
    """The studio's page as one HTML text, with stubs for the server.

    `answers` maps each path to the server's answer; where that is None, the request fails.
    """
    scripts = (*SCRIPTS, f"{FOLDER}/studio.js")
    common, *modules = ((ROOT / name).read_text("utf-8") for name in scripts)
    script = re.sub(r"^import .*$|^export ", "", "\n".join(modules), flags=re.MULTILINE)
    script = script.replace("IDLE_MS = 3000", "IDLE_MS = 30")
    given = f"var answers = {json.dumps(answers)};".replace("<", "\\u003c")
    stub = """
fetch = async (path) => {
  const answer = answers[path.split("?")[0]];
  if (answer === null) throw new TypeError("Failed to fetch");
  return new Response(JSON.stringify(answer));
};
"""
    scripts = f"<script>{common}\n{given}\n{stub}</script><script type=module>{script}</script>"
    outside = r'<script [^>]*src="[^"]*"></script>|<link rel="stylesheet"[^>]*>'
    page = re.sub(outside, "", answers["page"])
    return page.replace("</head>", f"{scripts}</head>")


@pytest.fixture
def studio(plate):
    """A studio whose folder holds one drawing."""
    return Answers(Folder(plate.parent))


@pytest.fixture
def read(studio):
    """The studio's answer to a preview of the drawing."""
    return {**preview(["plate.csv", "--units=mm"]), "command": "squeezetree try plate.csv"}


def state_of(studio):
    return json.loads(studio.state().body)


@pytest.fixture
def seen_in(studio, tmp_path):
    """A function that runs a script on the studio's page and returns the script's value.

    The function's other arguments are the server's answers about the folder and the drawing.
    """

    def play(script, folder, drawing):
        answers = {"page": studio.page().body.decode(), "/folder.json": folder, "/preview": drawing}
        return played(page_with(answers), script, tmp_path)

    return play


def test_plan_button_while_another_tab_plans_is_disabled_with_a_reason(
    studio, read, seen_in, tmp_path
):
    log = tmp_path / "plate.plan.jsonl"
    log.write_text('{"drawing": "plate.csv", "step": "try", "command": "squeezetree try"}\n')
    with closing(log.open("ab")) as planning:  # locked as by the planning process
        fcntl.flock(planning, fcntl.LOCK_EX)
        running = state_of(studio)
    log.write_text(log.read_text() + '{"exit": 0}\n')
    script = f"""
  const settled = async (disabled) => {{
    for (let k = 0; k < 50 && (byId("settings").hidden || byId("begin").disabled !== disabled); k++)
      await new Promise((done) => setTimeout(done, 10));
    return {{disabled: byId("begin").disabled, reason: byId("occupied").textContent}};
  }};
  const during = await settled(true);
  view.answers["/folder.json"] = {json.dumps(state_of(studio))};
  choose("plans", "plate");
  return {{during, after: await settled(false), error: byId("error").textContent}};
"""
    seen = seen_in(script, running, read)
    assert seen["during"]["disabled"]
    assert "plate is being planned" in seen["during"]["reason"]
    assert seen["after"] == {"disabled": False, "reason": ""}
    assert seen["error"] == ""


def test_preview_unanswered_by_a_killed_server_is_requested_again(studio, read, seen_in):
    script = f"""
  const shown = async (id, wanted) => {{
    for (let k = 0; k < 50 && byId(id).hidden === wanted; k++)
      await new Promise((done) => setTimeout(done, 10));
    return !byId(id).hidden;
  }};
  const lost = {{error: await shown("error", true), form: !byId("settings").hidden}};
  view.answers["/preview"] = {json.dumps(read)};
  const form = await shown("settings", true);
  return {{lost, form, error: !byId("error").hidden, facts: byId("facts").textContent}};
"""
    seen = seen_in(script, state_of(studio), None)
    assert seen["lost"] == {"error": True, "form": False}
    assert (seen["form"], seen["error"]) == (True, False)
    assert "30.0 x 21.0 mm" in seen["facts"]


def test_file_input_of_no_drawing_is_refused_without_the_server(studio, read, seen_in):
    script = """
  const files = new view.DataTransfer();
  files.items.add(new view.File(["x"], "photo.jpg"));
  byId("file").files = files.files;
  byId("file").dispatchEvent(new view.Event("change"));
  await new Promise((done) => setTimeout(done, 200));
  return byId("error").textContent;
"""
    assert seen_in(script, state_of(studio), read).startswith(
        "photo.jpg: is no drawing; those end in .dxf, .svg"
    )
