"""Where only the cell's part is installed, the planner's commands say so."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = "import sys; sys.modules['numpy'] = None; from planner.commands import {0}; sys.exit({0}())"


@pytest.mark.parametrize("command", ["compile_job", "simulate", "evaluate", "identify"])
def test_without_numpy_one_line_names_the_extra(command):
    words = [sys.executable, "-c", BLOCK.format(command)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "squeezetree[planner]" in done.stderr
