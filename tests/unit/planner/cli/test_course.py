"""The progress of commands: one bar for the whole work, never backwards, or plainly unknown."""

import re

import pytest

from planner.cli import course


def lines_of(capsys, clock, whole, message):
    with course.shown(False, whole, clock) as report:
        for now, *words in message:
            clock.now = now
            report(*words)
    return capsys.readouterr().err.splitlines()


def test_search_of_unknown_length_tells_the_time_so_far_and_nothing_else(capsys, clock):
    lines = [(6.0, "draft", 990, 1000, "2% open"), (12.0, "evaluate", 20, 20)]
    lines += [(18.0, "search", 5, 1000)]
    assert lines_of(capsys, clock, course.unknown, lines) == [
        "draft, 6 s so far, left: unknown, 2% open",
        "evaluate, 12 s so far, left: unknown",
        "search, 18 s so far, left: unknown",
    ]


@pytest.mark.parametrize(
    "whole", [course.counted, course.of_search, course.of_time(30.0), course.unknown]
)
def test_share_never_falls_and_nothing_is_left_of_work_that_goes_on(capsys, clock, whole):
    stages = [("draft", k, 10) for k in range(11)] + [("search", k, 10) for k in range(11)]
    entries = [(6.0 * k, *stage) for k, stage in enumerate(stages)]
    lines = lines_of(capsys, clock, whole, entries)
    shares = [int(matches[1]) for line in lines if (matches := re.match(r"(\d+)% done", line))]
    assert shares == sorted(shares)
    assert not any("about 0 s" in line for line in lines)
    assert lines[-1].endswith("left: unknown")


def test_search_share_begins_once_kernels_are_compiled(capsys, clock):
    lines = [(40.0, "kernels", 0, 1), (50.0, "search", 100, 1000), (60.0, "search", 300, 1000)]
    assert lines_of(capsys, clock, course.of_search, lines) == [
        "kernels, 40 s so far, left: unknown",
        "10% done, search, 50 s so far, left: unknown",
        "30% done, search, 60 s so far, left: about 35 s",
    ]


def test_budget_is_counted_down_and_unknown_beyond_its_end(capsys, clock):
    lines = [(0.0, "kernels", 0, 1), (15.0, "draft", 3, 1000)]
    lines += [(45.0, "search", 1, 9), (65.0, "evaluate", 1, 20)]
    assert lines_of(capsys, clock, course.of_time(60.0), lines) == [
        "25% done, draft, 15 s so far, left: about 45 s",
        "75% done, search, 45 s so far, left: about 15 s",
        "evaluate, 65 s so far, left: unknown",
    ]
