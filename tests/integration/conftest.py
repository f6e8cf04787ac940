"""Fixtures: an empty folder and an environment for the commands of a page, and a small table's file."""

import os
from pathlib import Path

import pytest
from documents import shims
from programs import ROOT
from sample_tables import small_table

from runtime.table import dump

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


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """The small table's file, alone in its folder."""
    dump(small_table(), tmp_path / "small.msgpack")
    return tmp_path / "small.msgpack"
