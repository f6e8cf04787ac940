"""How a drawing is to be read, and what it holds before it is a contour: rings and open strokes, in mm."""

import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NamedTuple, NoReturn

import numpy as np

from planner.arrays import Array
from planner.errors import InputFileError, OutlineError, UsageError

MAX_BYTES = 32 << 20
MAX_SHAPES = 20_000  # Most shapes a drawing may hold, blocks and copies written out
MAX_POINTS = 500_000  # Most points of all shapes together, curves flattened
SECONDS = 30.0  # Longest time that one file is read for
TOLERANCE_MM = 0.02
UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "m": 1000.0}
LARGEST_MM = 1e8  # Where the coordinates of a drawing end; beyond, a double no longer holds a micrometre well


class Options(NamedTuple):
    """How to read a file of any kind."""

    units: str | None = None  # one of `UNITS_MM`, or None to believe the file
    contour: int | None = None  # number of the contour, from 1, or None where there is only one
    tolerance_mm: float = TOLERANCE_MM  # largest distance of the outline from the curves drawn
    height_mm: float | None = None  # of the finger tips beside a solid, or None for `tips.tips_height_mm`
    layer: str | None = None  # of a DXF drawing, the only one to read; None for all that are visible
    scale: float | None = None  # mm a unit, for drawings in pixels; instead of units


class Pieces(NamedTuple):
    """The shapes of one file."""

    rings: list[Array]  # closed curves, each (n, 2) without its first point repeated [mm]
    strokes: list[Array]  # open ones, each (n, 2) [mm]
    notes: list[str]  # what a reader should know, one sentence each
    height_mm: float | None = None  # of a solid, from its lowest to its highest point


def need_units(where: str, said: str) -> UsageError:
    """The error of a file that does not tell its scale; `said` is why, as a clause about the file."""
    hint = "say what one unit is with --units mm, cm, in or m, or with --scale MM"
    error = UsageError(f"{where}: {said}; {hint}")
    error.units_missing = True
    return error


def too_much(where: str, what: str) -> OutlineError:
    """The error of a file that would take too long."""
    return OutlineError(f"{what}; export the part's outline alone", where=where)


def flattened(curve: Callable[[Array], Array], tolerance: float) -> Array:
    """Points (n, 2) of a curve, both ends included; no chord is further from it than a tolerance.

    `curve` takes (n,) parameters in [0, 1] and returns (n, 2) points in its own unit.
    """
    n = 8  # enough that a curve does not cross its chord in all the middles at once
    while True:
        points = curve(np.linspace(0.0, 1.0, 2 * n + 1))
        chords = 0.5 * (points[0:-1:2] + points[2::2])
        if np.max(np.hypot(*(points[1::2] - chords).T)) <= tolerance or n >= 1 << 14:
            return np.asarray(points[::2], dtype=np.float64)
        n *= 2


def sorted_out(curves: Iterable[Array], join_mm: float, where: str, notes: list[str]) -> Pieces:
    """Curves (n, 2) [mm] as rings and strokes: a ring ends where it began.

    Raises:
        OutlineError: a coordinate is not finite or too large, or there are too many points.
    """
    rings, strokes = [], []
    total = 0
    for curve in curves:
        total += len(curve)
        if total > MAX_POINTS:
            raise too_much(where, f"has more than {MAX_POINTS} points")
        if not np.isfinite(curve).all() or np.abs(curve).max(initial=0.0) > LARGEST_MM:
            raise OutlineError(
                "has a coordinate that is not finite or beyond 100 km; repair the drawing", where=where
            )
        if len(curve) > 2 and np.hypot(*(curve[0] - curve[-1])) <= join_mm:
            rings.append(curve[:-1])
        elif len(curve) > 1:
            strokes.append(curve)
    return Pieces(rings, strokes, notes)


@contextmanager
def time_limit(where: str, seconds: float = SECONDS) -> Iterator[None]:
    """Ends the reading of a file that takes too long; only in the main thread, where signals arrive."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_signum: int, _frame: FrameType | None) -> NoReturn:
        raise InputFileError(
            f"takes longer than {seconds:g} s to read; export the part's outline alone", where=where
        )

    usual = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, usual)
