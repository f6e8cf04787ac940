"""Every folder of trees/ holds a job that loads, describes its part, and states the symmetry rightly."""

import re
import tomllib

import pytest
from problems import diameter
from programs import TREES

from planner.job import model as job_file
from planner.job.overrides import changes_of

JOBS = {path.parent.name: path for path in sorted(TREES.glob("*/job.toml"))}
ROWS = tomllib.loads((TREES / "table1.toml").read_text())["row"]
FINGERS_PASS_MM = 60.0

part = pytest.mark.parametrize("name", JOBS)


@pytest.fixture(scope="module")
def jobs():
    return {name: job_file.load(path) for name, path in JOBS.items()}


def header(name):
    """The comment that a job file opens with, as one line."""
    lines = JOBS[name].read_text().splitlines()
    end = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    return " ".join(line.removeprefix("#").strip() for line in lines[:end])


def test_trees_folders_each_hold_a_job():
    assert {path.name for path in TREES.iterdir() if path.is_dir()} == set(JOBS)


@part
def test_job_header_describes_part_and_states_its_symmetry(name, jobs):
    text = header(name)
    assert len(text) > 40
    stated = re.search(r"Rotational order (\d+)\.", text)
    assert stated, f"{name}: the header lacks 'Rotational order n.'"
    assert jobs[name].part.symmetry == int(stated[1])


@part
def test_job_has_doubts_or_states_why_not(name):
    text = JOBS[name].read_text()
    assert ("\n[doubt]" in text) != ("\n# No [doubt]: " in text)


@part
def test_part_fits_between_jaws_at_any_angle(name, jobs):
    job = jobs[name]
    assert diameter(job.part.outline_mm) < FINGERS_PASS_MM
    assert len(job.part.outline_mm) <= 60


# The paper's Table I, columns 1 to 8*: part, radius of the disc in mm, actions, success on the robot.
TABLE_I = [
    ("1", "butterfly", 10.0, 4, 0.939),
    ("2", "butterfly", 15.0, 4, 0.835),
    ("3", "rectangle", 12.75, 4, 0.972),
    ("4", "rectangle", 12.75, 4, 0.872),
    ("5", "rectangle", 25.0, 20, 0.917),
    ("6", "rectangle", 25.0, 20, 0.896),
    ("7", "rectangle", 25.0, 20, 0.768),
    ("8*", "rectangle", 25.0, 20, 0.851),
]


def test_table1_rows_equal_table_of_paper(jobs):
    results = []
    for row in ROWS:
        job = jobs[row["part"]]
        actions = len(job.actions.angles_deg) * len(job.actions.centers_mm)
        about = job.part.name, job.uncertainty.radius_mm
        results.append((row["experiment"], *about, actions, row["paper"]))
    assert results == TABLE_I


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["experiment"])
def test_table1_row_is_accepted_as_change_of_its_job(row):
    job = job_file.load(JOBS[row["part"]], changes_of(row.get("job", ())))
    job.replaced(row["materials"], **changes_of(row["world"]))
