"""A project folder: names from a page reach its own files alone, nothing is overwritten, plans are known."""

import sys
import time

import pytest

from planner.studio import folder as folders
from planner.studio.folder import Folder, checked
from planner.studio.steps import written_for
from runtime.shell.errors import InputError, UsageError

PLANNER = """
import json, pathlib, sys, time
print(json.dumps({"drawing": sys.argv[3], "step": "try", "command": "c"}), flush=True)
while not pathlib.Path(sys.argv[2] + ".stop").exists(): time.sleep(0.01)
print(json.dumps({"exit": 0}), flush=True)
"""  # plans until it is stopped


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "plate.csv").write_text("0,0\n30,0\n30,21\n0,21\n")
    return Folder(tmp_path)


def until(condition):
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.parametrize(
    "name", ["", ".", "..", ".hidden", "a/b", "../a", "a\\b", "a\nb", "a\0b", "x" * 121, None, 7]
)
def test_a_name_that_is_none_of_a_file_here_is_refused(name):
    with pytest.raises(UsageError):
        checked(name)


@pytest.mark.parametrize("name", ["a b.dxf", "<b>'\"&.dxf", "Hebel ä.dxf", "-x.dxf", "a..b.dxf"])
def test_any_other_name_is_taken_as_it_is(name):
    assert checked(name) == name


def test_an_added_drawing_never_takes_the_place_of_another(folder):
    assert folder.add("plate.csv", b"other") == "plate-2.csv"
    assert folder.add("plate.csv", b"other") == "plate-2.csv"
    assert folder.add("plate.csv", b"third") == "plate-3.csv"
    assert (folder.path / "plate.csv").read_text().startswith("0,0")
    assert {path.name for path in folder.path.iterdir()} == {
        f"plate{n}.csv" for n in ("", "-2", "-3")
    }


def test_what_is_no_drawing_is_not_added(folder):
    for name in ("job.toml", "plate", "../plate.csv"):
        with pytest.raises(UsageError):
            folder.add(name, b"")


def test_links_hidden_files_and_folders_are_not_of_the_project(folder, tmp_path):
    (tmp_path / "link.csv").symlink_to("/etc/hostname")
    (tmp_path / ".secret").write_text("s")
    (tmp_path / "inner").mkdir()
    assert [file.name for file in folder.files()] == ["plate.csv"]
    with pytest.raises(UsageError):
        folder.read("link.csv", 100)
    with pytest.raises(OSError, match="folder"):
        folder.read("inner", 100)


def test_a_setting_stays_one_argument(folder):
    settings = {"units": "mm", "radius": " 5 ", "turn": "", "gripper": "--output=/tmp/x"}
    arguments = folder.arguments("plate.csv", settings)
    assert arguments == ["--units=mm", "--gripper=--output=/tmp/x", "--radius=5"]


@pytest.mark.parametrize("settings", [{"output": "x"}, {"radius": 5}, {"radius": ["5"]}])
def test_unknown_settings_are_refused(folder, settings):
    with pytest.raises(UsageError):
        folder.arguments("plate.csv", settings)


def test_a_drawing_that_is_gone_is_refused(folder):
    with pytest.raises(InputError, match="no file of this folder"):
        folder.arguments("gone.csv", {})


def test_one_plan_at_a_time_is_under_way_for_all_who_look(folder, monkeypatch):
    monkeypatch.setattr(folders, "PYTHON", [sys.executable, "-c", PLANNER])
    assert folder.begin("plate.csv", []) == "plate"
    other = Folder(folder.path)  # as after the studio was killed
    until(lambda: other.plans()[0].log.step)
    assert other.plans()[0].running
    with pytest.raises(UsageError, match="plate is being planned"):
        other.begin("plate.csv", [])
    other.stop("plate")
    until(lambda: not other.plans()[0].running)
    assert other.plans()[0].log.exit == 0
    with pytest.raises(UsageError, match="not being planned"):
        other.stop("plate")


def test_a_plan_takes_a_name_that_no_file_has(folder, monkeypatch):
    monkeypatch.setattr(folders, "PYTHON", [sys.executable, "-c", ""])
    (folder.path / written_for("plate")["table"]).write_bytes(b"mine")
    assert folder.begin("plate.csv", []) == "plate-2"
    until(lambda: not folder.plans()[0].running)
    assert folder.plans()[0].log.exit is None  # ended, and said nothing
    assert folder.begin("plate.csv", []) == "plate-3"
    assert (folder.path / written_for("plate")["table"]).read_bytes() == b"mine"
