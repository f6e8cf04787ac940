"""plan-init: from a drawing to a valid job, by flags or by answers at a terminal."""

import json
import os
import pty
import re
import subprocess
import sys
import tomllib
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
import trimesh
from drawings import dxf

from planner.cli import init
from planner.job import model as job_file
from planner.job.drafts import FINGERS, GRIPPERS
from planner.job.fields import REQUIRED
from planner.job.schema import ABSENT_SECTIONS, FIELDS, PRESSURE_FIELDS
from runtime.table import PROFILES, timing

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[4]
PLAN_INIT = Path(sys.executable).with_name("plan-init")
BRACKET = [(0, 0), (32, 0), (32, 12), (12, 12), (12, 24), (0, 24)]


def draw(folder, units=4):
    return dxf(folder, lambda space, _: space.add_lwpolyline(BRACKET, close=True), units)


@pytest.fixture
def drawing(tmp_path):
    return draw(tmp_path)


def words(drawing, output, *more):
    flags = ["--radius", "8", "--gripper", "robotiq-2f-85", "--fingers", "rubber"]
    return [str(drawing), "-o", str(output), *flags, *more]


def test_init_comments_show_the_defaults_of_the_job_fields(drawing, tmp_path):
    output = tmp_path / "job.toml"
    init.main(words(drawing, output))
    section, shown = "", {}
    for line in output.read_text().splitlines():
        if match := re.match(r"(?:# )?\[(\w+)\]", line):
            section = match[1]
        elif match := re.match(r"# (\w+ = .*)", line):
            shown |= {(section, key): value for key, value in tomllib.loads(match[1]).items()}
    assert len(shown) > 20
    for example in ("part height_mm", "part faces", "part picks"):
        del shown[tuple(example.split())]  # these have no default
    fitted = PRESSURE_FIELDS["boundary"]["limit_surface"]
    assert shown.pop(("pressure", "limit_surface")) == fitted.default
    del shown["actions", "pushes"], shown["goal", "identify"]
    del shown["cell", "regrasp_height_mm"]
    profile = PROFILES["robotiq-2f-85"]  # supplies the values that a job leaves out
    step_mm = profile.resolution_um / 1e3
    assert shown.pop(("gripper", "resolution_mm")) == pytest.approx(step_mm, 1e-3)
    assert shown.pop(("gripper", "noise_mm")) == profile.noise_um / 1e3
    assert shown.pop(("doubt", "encoder_mm")) == [-1.1, 1.1]
    cell = {key: shown.pop(("cell", key)) for key in timing.DEFAULTS}
    assert cell == timing.DEFAULTS
    for (name, key), value in shown.items():
        if name in ABSENT_SECTIONS and FIELDS[name][key].default in (None, REQUIRED):
            continue  # the comment shows an example, not a default
        default = FIELDS[name][key].default
        if name == "doubt" and default is None:
            default = 0.0  # a doubt left out is an offset of 0
        assert default == value if key != "wishart_dof" else value == 100


@pytest.mark.parametrize(("gripper", "fingers"), list(zip(GRIPPERS, cycle(FINGERS), strict=False)))
def test_init_each_gripper_and_fingers_preset_writes_a_valid_job(
    drawing, tmp_path, gripper, fingers
):
    output = tmp_path / "job.toml"
    more = ["--gripper", gripper, "--fingers", fingers, "--turn", "20", "--name", 'a "b" # c']
    assert init.main(words(drawing, output, *more)) == 0
    job = job_file.load(output)
    assert job.part.name == 'a "b" # c'
    assert job.gripper.model == gripper
    (shown,) = re.findall(r"(?m)^# encoder_mm = (\[.*?\])", output.read_text())
    assert tuple(json.loads(shown)) == job.doubt.encoder_mm
    assert job.uncertainty.orientation_halfwidth_deg == 20.0


def at_a_terminal(command, answers):
    """Runs a command on a pseudo-terminal and types the answers; returns its exit code and its output."""
    keyboard, screen = pty.openpty()
    with subprocess.Popen(command, cwd=ROOT, stdin=screen, stdout=screen, stderr=screen) as process:
        os.close(screen)
        os.write(keyboard, answers.encode())
        seen = b""
        try:
            while chunk := os.read(keyboard, 4096):
                seen += chunk
        except OSError:  # the other end is closed
            pass
        code = process.wait(timeout=60)
    os.close(keyboard)
    return code, seen.decode()


def test_init_at_a_terminal_asks_for_missing_answers(tmp_path):
    drawing = draw(tmp_path, 0)
    output = tmp_path / "job.toml"
    command = [PLAN_INIT, str(drawing), "-o", str(output)]
    code, seen = at_a_terminal(command, "parsec\nmm\nmy part\nhand-e\nsteel\n-x\n\nthin\n6\n")
    assert code == 0, seen
    assert "--units" in seen
    job = job_file.load(output)
    assert (job.part.name, job.gripper.model) == ("my part", "hand-e")
    assert 1.0 <= job.uncertainty.radius_mm <= 10.0
    assert (job.part.height_mm, job.cell.squeeze_height_mm) == (6.0, 3.0)


TALL = [(40.0, 20.0), (34.0, 14.0)]  # bottom and top of a tapered block 30 mm high [mm]


@pytest.mark.parametrize(
    ("stated", "tips", "length"),
    [((), 8.0, 38.4), (("--height", "20"), 20.0, 36.0), (("--thickness", "10"), 5.0, 39.0)],
)
def test_init_solid_outline_is_taken_at_the_squeeze_height(tmp_path, stated, tips, length):
    (a, b), (c, d) = TALL
    levels = ((0, a, b), (30, c, d))
    corners = [(x, y, z) for z, side, depth in levels for x in (0, side) for y in (0, depth)]
    solid, output = tmp_path / "tall.stl", tmp_path / "job.toml"
    trimesh.convex.convex_hull(np.array(corners, float)).export(solid)
    assert init.main(words(solid, output, "--units", "mm", *stated)) == 0
    job = job_file.load(output)
    assert job.cell.squeeze_height_mm == pytest.approx(tips)
    assert job.part.height_mm == 30.0  # whatever is stated, the hand has to pass over the solid
    assert np.ptp(job.part.outline_mm, axis=0).max() == pytest.approx(length)


@pytest.mark.parametrize(
    ("option", "value", "says"),
    [
        ("--tolerance", "-1", "not between 0.0001 and 1 mm"),
        ("--tolerance", "50", "not between 0.0001 and 1 mm"),
        ("--layer", "X", "--layer is for DXF drawings"),
        ("--scale", "2", "instead of --units"),
        ("--height", "0", "--height 0 is not between 0 and"),
        ("--height", "-3", "--height -3 is not between 0 and"),
    ],
)
def test_init_faces_with_an_option_out_of_range_is_refused(tmp_path, capsys, option, value, says):
    solid = tmp_path / "box.stl"
    trimesh.creation.box((30.0, 20.0, 12.0)).export(solid)
    assert (
        init.main(words(solid, tmp_path / "j.toml", "--units", "mm", "--faces", option, value)) == 2
    )
    assert says in capsys.readouterr().err
    assert not (tmp_path / "j.toml").exists()
