"""Progress of a command: one bar on a terminal, lines in a pipe."""

import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import progress as bars
from rich.console import Console

from planner.work.progress import Report, silent
from runtime.shell import command

OBJECTS_S = 0.3  # seconds between two JSON objects of progress
LINES_S = 5.0  # seconds between two lines of progress where no terminal shows a bar

Whole = Callable[[float, int, int], float | None]
"""A function of (seconds so far, done amount, total amount of the current stage).

It returns the share of a command's whole work that is done, 0 to 1, or None if the share is unknown.
"""


def unknown(_seconds: float, _done: int, _total: int) -> float | None:
    """Returns None: it is unknown which share of the work is done."""
    return None


def of_search(_seconds: float, done: int, total: int) -> float | None:
    """The share of a search that is done; None before the search begins, while kernels are compiled."""
    return done / total if total > 1 else None


def counted(_seconds: float, done: int, total: int) -> float | None:
    """Returns done / total as the share of the whole work; `done` and `total` must count the whole work."""
    return done / total if total else None


def of_time(expected_s: float) -> Whole:
    """Returns a function for the share of an expected time [s] that has passed.

    The function returns None once this time is over.
    """
    return lambda seconds, _done, _total: seconds / expected_s if seconds < expected_s else None


@contextmanager
def shown(
    quiet: bool, whole: Whole = unknown, clock: Callable[[], float] = time.monotonic
) -> Iterator[Report]:
    """Shows progress on standard error; yields `report(stage, done, total, detail)`.

    A terminal shows one bar for the whole work; the bar never goes back. Elsewhere a line is printed every
    `LINES_S` seconds, so that shorter work prints nothing. Bar and line state the time left, if it is known.

    Args:
        quiet: whether to show nothing.
        whole: returns the share of the work that is done.
        clock: returns the time in seconds.
    """
    console = Console(stderr=True)
    if quiet:
        yield silent
    elif not console.is_terminal:
        yield _spaced(_Course(whole, clock), LINES_S, 0.0, _sentence)
    else:
        columns = [
            bars.SpinnerColumn(),
            bars.TextColumn("{task.description}"),
            bars.BarColumn(),
            bars.TimeElapsedColumn(),
            bars.TextColumn("{task.fields[left]} {task.fields[detail]}"),
        ]
        with bars.Progress(*columns, console=console, transient=True) as bar:
            yield _drawn(bar, _Course(whole, clock))


class _Course:
    """Tracks the progress of a command's work, and estimates its end."""

    def __init__(self, whole: Whole, clock: Callable[[], float]) -> None:
        self.share = 0.0  # share of the whole work, never less than before
        self._whole, self._clock, self._begun = whole, clock, clock()
        self._first: tuple[float, float] | None = None  # seconds and value of the first known share
        self.known = False  # whether the latest report had a known share, less than 1

    def heard(self, done: int, total: int) -> None:
        """Updates the share of the whole work from the state of the current stage."""
        result = self._whole(self.seconds, done, total)
        self.known = result is not None and result < 1.0
        if result is not None:
            self.share = max(self.share, min(result, 1.0))
            self._first = self._first or (self.seconds, self.share)

    @property
    def seconds(self) -> float:
        """Seconds since the work began."""
        return self._clock() - self._begun

    def left(self) -> str:
        """Text for the time left, estimated from the speed of progress since the share was first known."""
        if self.known and self._first and self._first[1] < self.share < 1.0:
            since, share = self._first
            left_s = (self.seconds - since) * (1.0 - self.share) / (self.share - share)
            return f"left: about {math.ceil(left_s)} s"
        return "left: unknown"


def objects(whole: Whole) -> Report:
    """Returns a function that writes progress to standard error as JSON, one object a line.

    Keys: `stage`; `share` of the work (0 to 1, or null); `seconds` so far; `left` and `detail`, as texts for
    people.
    """
    return _spaced(_Course(whole, time.monotonic), OBJECTS_S, -math.inf, _object)


def _spaced(
    course: _Course, pause_s: float, last_s: float, line: Callable[[_Course, str, str], str]
) -> Report:
    """Returns a function that reports progress by lines on standard error, at least `pause_s` apart.

    Args:
        course: tracks the progress.
        pause_s: least time between two lines [s].
        last_s: when the first pause begins, in seconds since the work began; -inf: the first line is written
            at once.
        line: formats a line from the course, the name of a stage and its detail.
    """

    def report(name: str, done: int, total: int, detail: str = "", /) -> None:
        nonlocal last_s
        course.heard(done, total)
        if course.seconds - last_s >= pause_s:
            last_s = course.seconds
            command.say(line(course, name, detail), sys.stderr)

    return report


def _sentence(course: _Course, stage: str, detail: str) -> str:
    share = f"{course.share:.0%} done, " if course.known else ""
    words = [f"{share}{stage}", f"{course.seconds:.0f} s so far", course.left(), detail]
    return ", ".join(filter(None, words))


def _object(course: _Course, stage: str, detail: str) -> str:
    figures = {
        "stage": stage,
        "share": round(course.share, 3) if course.known else None,
        "seconds": round(course.seconds, 1),
        "left": course.left(),
        "detail": detail,
    }
    return json.dumps(figures)


def _drawn(bar: bars.Progress, course: _Course) -> Report:
    task = bar.add_task("starting", total=None, left="", detail="")

    def report(name: str, done: int, total: int, detail: str = "", /) -> None:
        course.heard(done, total)
        end, share, left = 1.0 if course.known else None, course.share, course.left()
        bar.update(task, description=name, completed=share, total=end, left=left, detail=detail)

    return report
