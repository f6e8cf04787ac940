"""SCHUNK's own tools, BKSModule and the scripts of bkstools, drive the simulated gripper without changes.

Each tool runs as a process: bkstools replaces `serial.Serial.read` on import, and keeps a file in the home
folder. Only the port's framing differs from that of a real gripper: a pseudo-terminal has no parity.
"""

import contextlib
import json
import os
import re
import sys
from pathlib import Path

import pytest
from programs import ended
from schunk_rigs import SchunkRig

SUPPORT = Path(__file__).parents[1] / "support"


@pytest.fixture
def rig():
    with contextlib.closing(SchunkRig("schunk-egu", scale=1.0)) as result:
        yield result


@pytest.fixture
def run(rig, tmp_path):
    """A function that runs a script of bkstools or a file of tests/support, and returns its output."""

    def run(what, *arguments):
        host = f"{rig.path},12,115200,8N1"
        if what.endswith(".py"):
            command = [SUPPORT / what, host, *arguments]
        else:
            command = ["-m", f"bkstools.scripts.{what}", "-H", host, *arguments]
        done = ended([sys.executable, *command], env={**os.environ, "HOME": str(tmp_path)})
        assert done.code == 0, done
        return done.out

    return run


@pytest.mark.timeout(300)
def test_schunk_model_bks_module_moves_grips_and_releases(rig, run):
    rig.part.width_mm = 41.237
    results = json.loads(run("bks_module_run.py").splitlines()[-1])
    assert (results["error at start"], results["ready"]) == (0xD9, True)
    places = {"absolute": 80.0, "absolute again": 60.0, "relative": 70.0, "grip": 41.237}
    for name, place in places.items():
        assert results[name]["mm"] == pytest.approx(place, abs=1e-3), name
        assert results[name]["success"], name
        assert results[name]["gripped"] == (name == "grip"), name
    assert results["release"]["mm"] == pytest.approx(46.237, abs=1e-3)
    assert results["grip at a width"]["gripped"]
    assert results["expected"] == {"max_pos": 120.0, "max_vel": 110.0}
    assert (rig.part.grips, rig.part.releases) == (2, 1)


@pytest.mark.timeout(300)
def test_schunk_model_bks_move_reaches_absolute_and_relative_widths(rig, run):
    said = run("bks_move", "--pos=30,60,10r", "--vel=110")
    reached = [float(width) for width in re.findall(r"reached (\S+) mm", said)]
    # bks_move reads the widths while the fingers still settle.
    assert reached == pytest.approx([30.0, 60.0, 70.0, 70.0], abs=0.2)
    assert "Gripper reported 0 errors and 0 warnings" in said
    assert rig.site.call(lambda: rig.model.opening_mm(rig.site.now())) == pytest.approx(
        70.0, abs=1e-3
    )


@pytest.mark.timeout(300)
def test_schunk_model_bks_grip_grips_releases_and_lists_messages(rig, run):
    run("bks_move", "--pos=100", "--vel=110")
    rig.part.width_mm = 91.237
    assert "Workpiece gripped at 91.2 mm" in run("bks_grip", "--force=100")
    assert "Release postion reached at 96.2 mm" in run("bks_grip", "--release")
    rig.site.call(lambda: rig.model.fail(0x74, rig.site.now()))
    said = run("bks_get_system_messages", "-i", "0-2")
    first, second, third = re.findall(r"\d{3}: '(.*)'", said)
    assert "motor supply is too low" in first
    assert "not acknowledged since power-on" in second
    assert third == ""
