"""The commands of README, tutorial and commissioning, run in an empty folder, print what the pages show."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from documents import DOCS, ROOT, Block, blocks, matches, run, shims

from planner.job import model as job_file
from planner.kernel import CACHE_VARIABLE, cache_folder
from runtime.execution import calibration
from runtime.table import wilson_interval

TIMED = re.compile(
    r"^(?:(Can .*\? Yes|The plan finds|located|error|effort|weakest|wrote .* after|plan .*msgpack)|limit).*"
)
HASTY = {"squeezetree": "from planner.cli import first_look; first_look.ANSWER_S = 7;"}
"""`squeezetree try` searches for seconds, not most of a minute; again, if that leaves it without a plan."""
RECTANGLE = ROOT / "trees" / "rectangle" / "rectangle.msgpack"


@pytest.fixture
def environment(tmp_path):
    programs = shims(tmp_path / "bin", HASTY)
    return {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


@pytest.fixture
def work(tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    return folder


def changed(block, changes):
    """A block with other words in its commands."""
    lines = block.commands
    for old, new in changes.items():
        lines = [line.replace(old, new) for line in lines]
    return block._replace(commands=lines)


def test_the_tutorial_runs_as_written(work, environment):
    found = blocks(DOCS / "tutorial.md")
    assert len(found) >= 7
    shutil.copy(DOCS / "lever.dxf", work)
    for block, lines in zip(found, run(found, work, environment), strict=False):
        assert matches(block.printed, lines)
    assert (work / "lever.html").stat().st_size < 3_000_000


def stated(job, **values):
    """The command that states values in a job file, whether it has them as comments or not."""
    edits = [f"s/^\\(# \\)\\?{key} = .*/{key} = {value}/" for key, value in values.items()]
    return f"sed -i '{'; '.join(edits)}' {job}"


# The page's search ends with its budget; this one is over before, on a busy machine too.
EASIER = {"--radius 5": "--radius 2 --turn 5", "--budget 20s": "--budget 60s"}


@pytest.mark.slow
def test_a_solid_becomes_a_running_cell_as_written_where_less_is_unknown(
    work, environment, tmp_path
):
    """Each located part is named rightly."""
    python = tmp_path / "bin" / "python3"
    python.write_text(f"#!/bin/sh\nexec '{sys.executable}' \"$@\"\n")
    python.chmod(0o755)
    found = [changed(block, EASIER) for block in blocks(DOCS / "from-a-solid.md")]
    assert len(found) == 4
    found[1].commands.append(stated("bracket.toml", particles=1000, search_particles=100))
    printed = run(found, work, environment)
    for block, lines in zip(found, printed, strict=False):  # what follows the last mark is empty
        assert matches(block.printed, lines)
    ends = re.findall(r"LEAF, leaf \d+, (.*?), \(.*; it is (.*)", "\n".join(printed[3]))
    assert ends
    assert all(said == true for said, true in ends)


@pytest.mark.slow
def test_the_readme_runs_as_written(work, environment):
    """All but its two scripts: `tools/demo` runs the same commands, `tools/check` this test.

    How far the search of `squeezetree try` comes within its budget, and so its figures, is up to the machine.
    """
    found = [
        block._replace(commands=[line for line in block.commands if not line.startswith("tools/")])
        for block in blocks(ROOT / "README.md")
    ]
    found = [block for block in found if block.commands]
    assert len(found) >= 2
    (work / "out").mkdir()
    (work / ".venv" / "bin").mkdir(parents=True)  # made by tools/demo
    (work / ".venv" / "bin" / "activate").touch()
    shutil.copytree(RECTANGLE.parent, work / "trees" / "rectangle")
    (work / "tools" / "docs").mkdir(parents=True)
    shutil.copy(DOCS / "lever.dxf", work / "tools" / "docs")
    home = {"HOME": str(work), CACHE_VARIABLE: str(cache_folder())}  # completion writes into it
    printed = run(found, work, environment | home)
    for block, lines in zip(found, printed, strict=False):
        timed = block.commands[0].startswith("squeezetree try ")
        assert matches(
            [TIMED.sub(r"\1...", line) if timed else line for line in block.printed], lines
        )


def calibrate(path: Path) -> None:
    """What `grasp-calibrate width` writes for a gripper whose counts are linear in the width."""
    counts = (230, 200, 150, 100, 50, 3)
    gauges = [calibration.Gauge((230 - count) * 85.0 / 227.0, (count,)) for count in counts]
    calibration.save(calibration.fit(gauges, "C-12345", "2026-01-01T00:00:00Z"), path)


def test_commissioning_runs_as_written_on_a_simulated_cell(work, environment):
    """All but three blocks: the first names the reader's devices, for which simulated ones stand here, and
    the calibrations need blocks between the fingers (other tests run those)."""
    names, look, gauge, meet, *others = blocks(DOCS / "commissioning.md")
    assert [line.partition("=")[0] for line in names.commands] == ["port"]
    assert gauge.commands[0].startswith("grasp-calibrate width ")
    assert meet.commands[0].startswith("grasp-calibrate middle ")
    shutil.copy(RECTANGLE, work)
    calibrate(work / "gripper.json")
    cell = [
        sys.executable,
        "-c",
        "from drivers.sim.cli import main; main()",
        "--until-stdin-closes",
        "--json",
    ]
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


@pytest.mark.parametrize(
    "job", sorted((ROOT / "trees").glob("*/job.toml")), ids=lambda path: path.parent.name
)
def test_rehearsal_in_the_air_is_a_job_that_is_accepted(job):
    """Every height that the page names, and that a job has, raised by what the page says."""
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


# What a page says of hundreds of parts, as a test tries it.
FEWER = {
    "--count 100 --seed 7": "--count 75 --seed 7",
    "--count 100 --seed 8": "--count 40 --seed 8",
}
FEWER |= {"--trials 2000": "--trials 300"}
FEWER |= {"--trials 4000": "--trials 500", "plan-refit": "plan-refit --seed 1"}


@pytest.mark.slow
def test_the_page_of_refit_runs_as_written_with_fewer_parts(work, environment):
    """The blind cell of the page: what journals and audits tell is written, and mends nearly all answers."""
    page = DOCS / "refit.md"
    (work / "hidden.py").write_text(
        re.search(r"```python\n(.*?)```", page.read_text(), re.DOTALL)[1]
    )
    shutil.copy(DOCS / "lever.dxf", work)
    made = "plan-init lever.dxf --units mm -o cell.toml --radius 10 --turn 20 --fingers rubber"
    made += " --gripper robotiq-2f-85"
    known = stated("cell.toml", finger_part_min=0.4, finger_part_max=0.6)
    begin = Block([made, known, "plan-compile cell.toml -o cell.msgpack --trials 300"], [])
    found = []
    for block in blocks(page):
        fewer = changed(block, FEWER)
        found.append(
            fewer._replace(commands=[f"{line} || test $? -eq 13" for line in fewer.commands])
        )
    printed = run([begin, *found], work, environment | {"PYTHONPATH": f"{ROOT}:{work}"})
    assert any(line.startswith("advice    a refit would pay") for line in printed[1])
    assert any(line.startswith("  widths read +0.") for line in printed[3])
    assert any(line.startswith("  the fingers meet -") for line in printed[3])
    low, high = tomllib.loads((work / "cell2.toml").read_text())["doubt"]["encoder_mm"]
    assert 0.0 < low < 0.6 < high < 1.2  # the preset's were -1.1 and 1.1
    before, after = (json.loads(line) for line in printed[4] if line.startswith("{"))
    assert before["wrong_rate"] > 0.3
    assert after["wrong_rate"] < 0.1 * before["wrong_rate"]


def test_a_hundred_good_parts_say_what_the_page_says():
    assert 0.96 < wilson_interval(100, 100)[0] < 0.97
