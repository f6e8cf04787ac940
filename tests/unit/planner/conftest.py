"""The rectangle's job and table, which most tests of the planner plan with."""

from pathlib import Path

import pytest

from planner.job import model as job_file
from planner.job.model import Job
from runtime.table import Table, load

RECTANGLE = Path(__file__).parents[3] / "trees" / "rectangle"


@pytest.fixture(scope="session")
def job() -> Job:
    return job_file.load(RECTANGLE / "job.toml")


@pytest.fixture(scope="session")
def table() -> Table:
    return load(RECTANGLE / "rectangle.msgpack").table
