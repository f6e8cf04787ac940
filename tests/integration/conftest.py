"""An empty folder to follow a page in, and the environment of its commands."""

import os

import pytest
from documents import ROOT, shims

LOW_EFFORT = {"squeezetree": "from planner.cli import first_look; first_look.ANSWER_S = 7;"}
"""`squeezetree try` searches for seconds, not most of a minute; again, if that leaves it without a plan."""


@pytest.fixture
def environment(tmp_path):
    programs = shims(tmp_path / "bin", LOW_EFFORT)
    return {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


@pytest.fixture
def work(tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    return folder
