"""An empty folder to follow a page in, the environment of its commands, and a small table."""

import os
from pathlib import Path

import pytest
from documents import shims
from programs import ROOT
from sample_tables import small_table

from runtime.table import dump

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


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """The small table's file, alone in its folder."""
    dump(small_table(), tmp_path / "small.msgpack")
    return tmp_path / "small.msgpack"
