"""The files of a first answer overwrite those of an earlier one for the same job, and no others."""

from dataclasses import replace

import pytest
from rectangle import JOB_PATH, TABLE_PATH

from planner.cli import first_look
from planner.cli.first_plan import QUICK
from planner.job import model
from runtime.table import dump, load

TEXT = JOB_PATH.read_text()


@pytest.fixture
def files(tmp_path):
    return first_look._beside(tmp_path / "lever.toml")


def table_of(path, **search):
    """Writes a table that is compiled, by what it says, from the job with these settings of the search."""
    job = model.parse(TEXT).replaced(search=search)
    table = replace(load(TABLE_PATH).table, job=job.canonical(), job_digest=job.digest())
    dump(table, path)


def test_taken_free_names_and_files_of_the_same_answer_are_none(files):
    assert first_look._taken(files, TEXT) is None
    files.job.write_text(TEXT)
    files.picture.write_text("<svg/>")
    assert first_look._taken(files, TEXT) is None
    table_of(files.table, **QUICK)
    assert first_look._taken(files, TEXT) is None


@pytest.mark.parametrize("name", ["table", "picture"])
def test_taken_file_without_its_job_is_somebody_elses(files, name):
    getattr(files, name).write_text("unrelated")
    assert first_look._taken(files, TEXT) == getattr(files, name)


def test_taken_other_job_or_table_of_a_full_search_is_kept(files):
    files.job.write_text(TEXT)
    table_of(files.table)
    assert first_look._taken(files, TEXT) == files.table
    files.table.write_bytes(b"damaged")
    assert first_look._taken(files, TEXT) == files.table
    files.job.write_text(TEXT + "# mine\n")
    assert first_look._taken(files, TEXT) == files.job
