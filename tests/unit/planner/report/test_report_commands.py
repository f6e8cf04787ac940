"""plan-simulate: poses in degrees, options of its pictures. Importing the commands loads no slow library."""

import csv
import math
import subprocess
import sys
from pathlib import Path

import pytest
from programs import Ended, called
from rectangle import JOB_PATH

from planner.cli import simulate

pytestmark = pytest.mark.slow


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    path = tmp_path / "in.csv"
    path.write_text("x_mm,y_mm,theta_rad\n-10,7,-0.3\n5,-7,2.5\n60,0,0\n")
    return path


def run(poses: Path, *options: str) -> Ended:
    output = poses.parent / "out.csv"
    return called(simulate.main, JOB_PATH, "--poses", poses, "-o", output, *options)


def test_simulate_poses_in_degrees_end_as_those_in_radians(poses: Path) -> None:
    output = poses.parent / "out.csv"
    assert run(poses, "--nominal", "--mu", "0.5").code == 0
    radians = list(csv.DictReader(output.read_text().splitlines()))
    for row in radians:
        for name in ("theta", "final_theta"):
            degrees = math.degrees(float(row[f"{name}_rad"]))
            assert float(row[f"{name}_deg"]) == pytest.approx(degrees)
    lines = [f"{row['x_mm']},{row['y_mm']},{row['theta_deg']}" for row in radians]
    poses.write_text("\n".join(["x_mm,y_mm,theta_deg", *lines]) + "\n")
    assert run(poses, "--nominal", "--mu", "0.5").code == 0
    for row, same in zip(radians, csv.DictReader(output.read_text().splitlines()), strict=True):
        assert row["status"] == same["status"]
        for name in ("final_x_mm", "final_y_mm", "final_theta_deg", "theta_rad"):
            assert float(row[name]) == pytest.approx(float(same[name]), abs=1e-4)


def test_simulate_poses_with_two_unequal_angles_are_refused(poses: Path) -> None:
    poses.write_text("x_mm,y_mm,theta_rad,theta_deg\n1,2,0.1,5.729578\n1,2,0.1,30\n")
    ended = run(poses)
    assert (ended.code, ended.one_line) == (3, True)
    assert "pose 2" in ended.err


@pytest.mark.parametrize(
    "options",
    [("--figure", "s.jpg"), ("--html", "s"), ("--figure", "nowhere/s.png"), ("--html", ".")],
)
def test_simulate_wrong_picture_name_is_refused_before_any_work(
    poses: Path, options: tuple[str, str]
) -> None:
    ended = run(poses, *options)
    assert (ended.code, ended.one_line) == (2, True)
    assert options[1] in ended.err
    assert not (poses.parent / "out.csv").exists()


def test_commands_when_imported_load_no_slow_library() -> None:
    script = (
        "import sys, planner.cli.simulate, planner.cli.compile, planner.cli.evaluate; "
        "sys.exit(not {'matplotlib', 'sklearn', 'scipy.stats'}.isdisjoint(sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
