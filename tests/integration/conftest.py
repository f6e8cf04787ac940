"""Fixtures: an empty folder and an environment for the commands of a page."""

import os

import pytest
from documents import shims
from programs import ROOT

LOW_EFFORT = {"squeezetree": "from planner.cli import first_look; first_look.ANSWER_S = 7;"}
"""Reduces the time of `squeezetree try` to 7 s; it searches again where that gives no plan."""


@pytest.fixture
def environment(tmp_path):
    programs = shims(tmp_path / "bin", LOW_EFFORT)
    return {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


@pytest.fixture
def work(tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    return folder
