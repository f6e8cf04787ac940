"""The grade of a first answer, where the search is done and where it is not."""

import pytest

from planner.cli.first_look import _short


@pytest.mark.parametrize(
    ("grade", "success", "open_share", "short"),
    [
        ("good", 0.999, 0.0, "good"),
        ("fair", 0.95, 0.02, "fair"),
        ("poor", 0.40, 0.0, "poor"),
        ("poor", 0.75, 0.24, "cut"),
        ("poor", 0.50, 0.24, "poor"),
        ("poor", 0.40, 0.59, "unknown"),
        ("poor", 0.05, 0.94, "unknown"),
        ("poor", 0.0, 0.94, "unknown"),
    ],
)
def test_grade_of_a_search_that_is_not_done_says_no_more_than_is_known(
    grade, success, open_share, short
):
    assert _short(grade, success, open_share) == short
