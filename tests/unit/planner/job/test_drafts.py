"""Drafts of jobs: names that nobody chose."""

from pathlib import Path

import pytest

from planner.job.drafts import name_of
from planner.job.schema import FIELDS


@pytest.mark.parametrize(
    ("stem", "name"),
    [
        ("lever", "lever"),
        ("a\nb", "a\\nb"),
        (" ", "part"),
        ("x" * 200, "x" * 60),
        ("\u4e09" * 90, "\u4e09" * 60),
    ],
)
def test_name_of_any_drawing_is_a_valid_name_of_a_part(stem, name):
    assert name_of(Path(f"{stem}.dxf")) == name
    assert FIELDS["part"]["name"].read(name) == name
