"""Fixtures: the job and the table of the rectangle, and a clock."""

import pytest
from rectangle import JOB_PATH, TABLE_PATH

from planner.job import model as job_file
from planner.job.model import Job
from runtime.table import Table, load


@pytest.fixture(scope="session")
def job() -> Job:
    return job_file.load(JOB_PATH)


@pytest.fixture(scope="session")
def table() -> Table:
    return load(TABLE_PATH).table


class Clock:
    """A clock that stands still until a test sets `now`."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()
