"""Where only the cell's part is installed, the planner's commands say so."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BLOCK = "import sys; sys.modules['numpy'] = None; from planner.commands import {0}; sys.exit({0}())"


@pytest.mark.parametrize(
    "command",
    [
        "compile_job",
        "simulate",
        "evaluate",
        "expect",
        "identify",
        "report",
        "init",
        "studio",
        "try_part",
    ],
)
def test_without_numpy_one_line_names_the_extra(command):
    words = [sys.executable, "-c", BLOCK.format(command)]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "squeezetree[planner]" in done.stderr


@pytest.mark.parametrize("call", ["audit(['judge'])", "calibrate(['camera'])"])
def test_without_opencv_one_line_names_the_audit_extra(call):
    code = f"import sys; sys.modules['cv2'] = None; from drivers.camera.commands import *; sys.exit({call})"
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "squeezetree[audit]" in done.stderr


@pytest.mark.parametrize("word", ["report", "study"])
def test_report_and_study_need_neither_numpy_nor_opencv(word):
    code = (
        "import sys; sys.modules['numpy'] = sys.modules['cv2'] = None; "
        f"from drivers.camera.commands import audit; sys.exit(audit(['{word}', 'none.jsonl']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 24
    assert "none.jsonl" in done.stderr


def test_cell_without_opencv_names_the_audit_extra_if_asked_for_a_camera():
    code = "import sys; sys.modules['cv2'] = None; from drivers.sim.cli import main; sys.exit(main({0}))"
    words = ["--tree", str(ROOT / "trees" / "rectangle" / "rectangle.msgpack"), "--camera"]
    command = [sys.executable, "-c", code.format(words)]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "squeezetree[audit]" in done.stderr


def test_without_gymnasium_the_environment_names_its_extra():
    code = "import sys; sys.modules['gymnasium'] = None; import planner.gym"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "pip install 'squeezetree[gym]'" in done.stderr.splitlines()[-1]
