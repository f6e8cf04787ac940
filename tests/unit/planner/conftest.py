"""The rectangle's job and table, which most tests of the planner plan with."""

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
