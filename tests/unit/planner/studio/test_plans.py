"""The plans of a folder: only one is made at a time, across all processes, and no two share a file."""

import sys
import threading

import pytest
from programs import until

from planner.studio import plans as studio_plans
from planner.studio.folder import Folder
from planner.studio.plans import Plans
from planner.studio.steps import written_for
from runtime.shell.errors import UsageError

PLANNER = """
import json, pathlib, sys, time
print(json.dumps({"drawing": sys.argv[3], "step": "try", "command": "c"}), flush=True)
while not pathlib.Path(sys.argv[2] + ".stop").exists(): time.sleep(0.01)
print(json.dumps({"exit": 0}), flush=True)
"""
"""A planning process that runs until it is stopped."""


@pytest.fixture
def plans(plate):
    return Plans(Folder(plate.parent))


@pytest.mark.parametrize("settings", [{"output": "x"}, {"radius": 5}, {"radius": ["5"]}])
def test_arguments_unknown_settings_are_refused(plans, settings):
    with pytest.raises(UsageError):
        plans.arguments("plate.csv", settings)


def test_begin_while_a_plan_is_under_way_is_refused_and_stop_ends_it(plans, monkeypatch):
    monkeypatch.setattr(studio_plans, "PYTHON", [sys.executable, "-c", PLANNER])
    assert plans.begin("plate.csv", []) == "plate"
    other = Plans(Folder(plans.folder.path))  # as after a restart of the studio
    until(lambda: other.all()[0].log.step)
    assert other.all()[0].running
    with pytest.raises(UsageError, match="plate is being planned"):
        other.begin("plate.csv", [])
    other.stop("plate")
    until(lambda: not (other.all()[0].running or other.all()[0].trying))
    assert other.all()[0].log.exit == 0
    with pytest.raises(UsageError, match="not being planned"):
        other.stop("plate")


def test_begin_from_several_threads_starts_one_plan(plans, monkeypatch):
    monkeypatch.setattr(studio_plans, "PYTHON", [sys.executable, "-c", PLANNER])
    begun, refused = [], []

    def begin():
        try:
            begun.append(plans.begin("plate.csv", []))
        except UsageError as error:
            refused.append(str(error))

    pages = [threading.Thread(target=begin) for _ in range(4)]
    for page in pages:
        page.start()
    for page in pages:
        page.join()
    assert begun == ["plate"]
    assert len(refused) == 3
    assert all("plate is being planned" in reason for reason in refused)
    plans.stop("plate")


def test_begin_taken_name_gets_a_number(plans, monkeypatch):
    monkeypatch.setattr(studio_plans, "PYTHON", [sys.executable, "-c", ""])
    (plans.folder.path / written_for("plate")["table"]).write_bytes(b"mine")
    assert plans.begin("plate.csv", []) == "plate-2"
    until(lambda: not plans.all()[0].running)
    assert plans.all()[0].log.exit is None  # the process ended without a record
    assert plans.begin("plate.csv", []) == "plate-3"
    assert (plans.folder.path / written_for("plate")["table"]).read_bytes() == b"mine"
