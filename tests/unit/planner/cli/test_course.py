"""The progress of commands: the share of the whole work that is done, and the time left.

The share never falls. Where the whole is unknown, only the elapsed time is printed.
"""

import re

import pytest

from planner.cli import course


def lines_of(capsys, clock, whole, reports):
    """The lines that `shown` prints for some reports; a report is (time, stage, done, total, detail)."""
    with course.shown(False, whole, clock) as report:
        for now, *stage in reports:
            clock.now = now
            report(*stage)
    return capsys.readouterr().err.splitlines()


def test_shown_work_of_unknown_length_prints_elapsed_time_only(capsys, clock):
    reports = [(6.0, "draft", 990, 1000, "2% open"), (12.0, "evaluate", 20, 20)]
    reports += [(18.0, "search", 5, 1000)]
    assert lines_of(capsys, clock, course.unknown, reports) == [
        "draft, 6 s so far, left: unknown, 2% open",
        "evaluate, 12 s so far, left: unknown",
        "search, 18 s so far, left: unknown",
    ]


@pytest.mark.parametrize(
    "whole", [course.counted, course.of_search, course.of_time(30.0), course.unknown]
)
def test_shown_share_never_falls_and_ends_with_unknown_time_left(capsys, clock, whole):
    stages = [("draft", k, 10) for k in range(11)] + [("search", k, 10) for k in range(11)]
    reports = [(6.0 * k, *stage) for k, stage in enumerate(stages)]
    lines = lines_of(capsys, clock, whole, reports)
    shares = [int(matches[1]) for line in lines if (matches := re.match(r"(\d+)% done", line))]
    assert shares == sorted(shares)
    assert not any("about 0 s" in line for line in lines)
    assert lines[-1].endswith("left: unknown")


def test_of_search_while_kernels_compile_share_is_unknown(capsys, clock):
    reports = [(40.0, "kernels", 0, 1), (50.0, "search", 100, 1000), (60.0, "search", 300, 1000)]
    assert lines_of(capsys, clock, course.of_search, reports) == [
        "kernels, 40 s so far, left: unknown",
        "10% done, search, 50 s so far, left: unknown",
        "30% done, search, 60 s so far, left: about 35 s",
    ]


def test_of_time_counts_down_and_is_unknown_after_its_end(capsys, clock):
    reports = [(0.0, "kernels", 0, 1), (15.0, "draft", 3, 1000)]
    reports += [(45.0, "search", 1, 9), (65.0, "evaluate", 1, 20)]
    assert lines_of(capsys, clock, course.of_time(60.0), reports) == [
        "25% done, draft, 15 s so far, left: about 45 s",
        "75% done, search, 45 s so far, left: about 15 s",
        "evaluate, 65 s so far, left: unknown",
    ]
