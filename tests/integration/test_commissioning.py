"""The commands of commissioning, run in an empty folder, print what the page shows."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from counting import PROFILE, width_um
from documents import DOCS, ROOT, blocks, matches, run

from planner.job import model as job_file
from runtime.execution import calibration
from runtime.table import wilson_interval

RECTANGLE = ROOT / "trees" / "rectangle" / "rectangle.msgpack"


def calibrate(path: Path) -> None:
    """What `grasp-calibrate width` writes for a gripper whose counts are linear in the width."""
    counts = (230, 200, 150, 100, 50, 3)
    gauges = [
        calibration.Gauge((230 - count) * 85.0 / 227.0, (width_um(count),)) for count in counts
    ]
    calibration.save(calibration.fit(gauges, PROFILE, "C-12345", "2026-01-01T00:00:00Z"), path)


def test_commissioning_runs_as_written_on_a_simulated_cell(work, environment):
    """All but three blocks: the first names the reader's devices, for which simulated ones stand here, and
    the calibrations need blocks between the fingers (other tests run those)."""
    names, look, gauge, meet, *others = blocks(DOCS / "commissioning.md")
    assert [line.partition("=")[0] for line in names.commands] == ["port"]
    assert gauge.commands[0].startswith("grasp-calibrate width ")
    assert meet.commands[0].startswith("grasp-calibrate middle ")
    shutil.copy(RECTANGLE, work)
    calibrate(work / "gripper.json")
    cell = [sys.executable, "-m", "drivers.sim.cli", "--until-stdin-closes", "--json"]
    with subprocess.Popen(
        [*cell, "--tree", str(RECTANGLE), "--time-scale", "100"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        cwd=ROOT,
        text=True,
    ) as simulated:
        ends = json.loads(simulated.stdout.readline())
        here = names._replace(
            commands=[f"port={ends['gripper']}; arm={ends['arm']}; tree=rectangle.msgpack"]
        )
        printed = run([here, look, *others], work, environment)
        simulated.stdin.close()
    for block, lines in zip([look, *others], printed[1:], strict=False):
        assert matches(block.printed, lines)
    assert (work / "report.html").stat().st_size < 3_000_000


@pytest.mark.parametrize("part", ["rectangle", "gusset"])
def test_rehearsal_in_the_air_is_a_job_that_is_accepted(part):
    """Every height that the page names, and that a job has, raised by what the page says.

    100 good parts say what it says, too.
    """
    job = ROOT / "trees" / part / "job.toml"
    assert 0.96 < wilson_interval(100, 100)[0] < 0.97
    step = re.search(
        r"\*\*In the air\.\*\*(.*?)\n\d\. ", (DOCS / "commissioning.md").read_text(), re.DOTALL
    )[1]
    (more_mm,) = map(float, re.findall(r"by (\d+) mm", step))
    keys = set(re.findall(r"`(\w+_mm)`", step))
    assert "squeeze_height_mm" in keys
    sound = job_file.load(job)
    raised = {}
    for section in ("part", "cell"):
        of_section = getattr(sound, section)
        stated = {key: getattr(of_section, key) for key in keys if hasattr(of_section, key)}
        raised[section] = {
            key: height + more_mm for key, height in stated.items() if height is not None
        }
    assert raised["cell"].keys() == {"squeeze_height_mm", "retreat_height_mm"}
    air = job_file.load(job, raised)
    assert air.cell.squeeze_height_mm == sound.cell.squeeze_height_mm + more_mm
    assert air.cell.retreat_height_mm == sound.cell.retreat_height_mm + more_mm
