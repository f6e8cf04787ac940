"""The commands of the commissioning page, run in an empty folder on a simulated cell."""

import json
import re
import shutil
import subprocess

import pytest
from calibrations import linear
from documents import DOCS, blocks, matches, run
from programs import CELL, TABLE, TREES, started

from planner.job import model as job_file
from runtime.table import wilson_interval


def test_commissioning_page_commands_print_shown_output(work, environment):
    """The page's first block names the devices of a real cell; the test names simulated devices instead.

    The two calibrations are left out, since they need gauge blocks between the fingers; other tests run them.
    """
    names, look, gauge, meet, *others = blocks(DOCS / "commissioning.md")
    assert [line.partition("=")[0] for line in names.commands] == ["port"]
    assert gauge.commands[0].startswith("grasp-calibrate width ")
    assert meet.commands[0].startswith("grasp-calibrate middle ")
    shutil.copy(TABLE, work)
    linear(work / "gripper.json", "C-12345")
    cell = [*CELL, "--until-stdin-closes", "--json", "--tree", TABLE, "--time-scale", "100"]
    with started(cell, stdin=subprocess.PIPE, stderr=None, env=environment) as simulated:
        ends = json.loads(simulated.stdout.readline())
        named = f"port={ends['gripper']}; arm={ends['arm']}; tree=rectangle.msgpack"
        here = names._replace(commands=[named])
        printed = run([here, look, *others], work, environment)
        simulated.stdin.close()
    for block, lines in zip([look, *others], printed[1:], strict=False):
        assert matches(block.printed, lines)
    assert (work / "report.html").stat().st_size < 3_000_000


@pytest.mark.parametrize("part", ["rectangle", "gusset"])
def test_commissioning_page_heights_raised_in_air_give_valid_job(part):
    """The step "In the air" of the page names heights of the job, and says by how much to raise them."""
    job = TREES / part / "job.toml"
    assert 0.96 < wilson_interval(100, 100)[0] < 0.97  # what the page's hundred parts can prove
    text = (DOCS / "commissioning.md").read_text()
    step = re.search(r"\*\*In the air\.\*\*(.*?)\n\d\. ", text, re.DOTALL)[1]
    (more_mm,) = map(float, re.findall(r"by (\d+) mm", step))
    keys = set(re.findall(r"`(\w+_mm)`", step))
    assert "squeeze_height_mm" in keys
    sound = job_file.load(job)
    raised = {}
    for section in ("part", "cell"):
        of_section = getattr(sound, section)
        stated = {key: getattr(of_section, key) for key in keys if hasattr(of_section, key)}
        raised[section] = {key: mm + more_mm for key, mm in stated.items() if mm is not None}
    assert raised["cell"].keys() == {"squeeze_height_mm", "retreat_height_mm"}
    air = job_file.load(job, raised)
    assert air.cell.squeeze_height_mm == sound.cell.squeeze_height_mm + more_mm
    assert air.cell.retreat_height_mm == sound.cell.retreat_height_mm + more_mm
