"""Options for reading a drawing, and the shapes of a drawing before they form contours: rings and strokes."""

import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NamedTuple, NoReturn

import numpy as np

from planner.arrays import Array
from planner.errors import UnitsMissingError
from planner.part.outline import REPEAT_MM
from runtime.shell.errors import InputError

MAX_BYTES = 32 << 20
MAX_SHAPES = 20_000  # Most shapes of a drawing, blocks and copies expanded
MAX_POINTS = 500_000  # Most points of all shapes together, curves flattened
SECONDS = 30.0  # Longest time for reading one file
TOLERANCE_MM = 0.02
UNITS_MM = {"mm": 1.0, "cm": 10.0, "in": 25.4, "m": 1000.0}
CLOSED = 0.1  # largest gap between the ends of a ring, as a share of its length
LARGEST_MM = 1e10  # Largest coordinate; beyond, as on maps, a double does not resolve a micrometre


class Options(NamedTuple):
    """Options for reading a file of any format."""

    units: str | None = None  # one of `UNITS_MM`; None: the unit that the file states
    contour: int | None = None  # number of the contour, from 1; None: the only outer one
    tolerance_mm: float = TOLERANCE_MM  # largest distance of the outline from the curves drawn
    height_mm: float | None = None  # height of the tips beside a solid; None: `tips.tips_height_mm`
    layer: str | None = None  # the layer of a DXF drawing to read; None for all visible ones
    scale: float | None = None  # mm of one unit, for drawings in pixels; instead of units

    @property
    def unit_mm(self) -> float | None:
        """Size of one unit of the drawing [mm]; None: the file states the unit."""
        return self.scale or (UNITS_MM[self.units] if self.units else None)

    @property
    def chord_mm(self) -> float:
        """Largest distance of a chord from its curve: half the tolerance.

        The removal of vertices may use the other half.
        """
        return 0.5 * self.tolerance_mm


class Lost(NamedTuple):
    """A shape of a drawing that is not read and may be the part's outline."""

    what: str  # description and reason, for people
    box: Array | None = None  # (2, 2) least and greatest coordinates [mm]; None: unknown


class Pieces(NamedTuple):
    """The shapes of one file, sorted into closed rings and open strokes."""

    rings: list[Array]  # closed curves, each (n, 2), first point not repeated [mm]
    strokes: list[Array]  # open curves, each (n, 2) [mm]
    notes: list[str]  # notes on the drawing, one sentence each
    layers: tuple[str, ...]  # layer of each ring, then of each stroke; "" in formats without layers
    height_mm: float | None = None  # height of a solid; None for a drawing
    lost: tuple[Lost, ...] = ()  # shapes that were not read


def need_units(said: str) -> UnitsMissingError:
    """Returns the error about a file without a scale; `said` is the reason, a verb phrase about the file."""
    hint = "say what one unit is with --units mm, cm, in or m, or with --scale MM"
    return UnitsMissingError(f"{said}; {hint}")


def too_much(what: str) -> InputError:
    """Returns the error about a file that would take too long; `what` is the reason, a verb phrase."""
    return InputError(f"{what}; export the part's outline alone")


def flattened(
    curve: Callable[[Array], Array], tolerance: float, low: float = 0.0, high: float = 1.0
) -> Array:
    """Returns points (n, 2) of a curve, both ends included; the chords between them lie within a tolerance.

    `curve` takes (n,) parameters from `low` to `high` and returns (n, 2) points in its own unit.
    """
    n = 8  # with fewer chords, a curve might pass through the middles of all of them and seem straight
    while True:
        points = curve(np.linspace(low, high, 2 * n + 1))
        chords = 0.5 * (points[0:-1:2] + points[2::2])
        if np.max(np.hypot(*(points[1::2] - chords).T)) <= tolerance or n >= 1 << 14:
            return np.asarray(points[::2], dtype=np.float64)
        n *= 2


class Curve(NamedTuple):
    """A curve of a drawing, with the layer on which it lies."""

    points: Array  # (n, 2) [mm]
    layer: str


def sorted_out(curves: Iterable[Array | Curve], join_mm: float, notes: list[str]) -> Pieces:
    """Sorts curves (n, 2) [mm] into closed rings and open strokes.

    The ends of a ring are at most `join_mm` apart, and also at most a tenth of the ring's length. So a short
    line is a stroke, although its ends are near each other.

    Raises:
        InputError: a coordinate is not finite or too large, or there are too many points.
    """
    rings, strokes = list[Curve](), list[Curve]()
    total = 0
    for drawn in curves:
        curve = drawn if isinstance(drawn, Curve) else Curve(drawn, "")
        points = curve.points
        total += len(points)
        if total > MAX_POINTS:
            raise too_much(f"has more than {MAX_POINTS} points")
        if not np.abs(points).max(initial=0.0) <= LARGEST_MM:  # also of nan
            problem = "has a coordinate that is not finite or beyond 10000 km"
            raise InputError(f"{problem}; repair the drawing")
        steps = np.hypot(*np.diff(points, axis=0).T)
        gap = float(np.hypot(*(points[0] - points[-1]))) if len(points) else 0.0
        if len(points) > 2 and gap <= min(join_mm, CLOSED * float(steps.sum())):
            rings.append(curve._replace(points=points[:-1] if gap <= REPEAT_MM else points))
        elif len(points) > 1 and steps.any():
            strokes.append(curve)
    layers = tuple(curve.layer for curve in (*rings, *strokes))
    closed, opened = ([curve.points for curve in some] for some in (rings, strokes))
    return Pieces(closed, opened, notes, layers)


def place(point: Array) -> str:
    """Formats a point (2,) of a drawing as text, rounded to 0.01 mm at any distance from the origin."""
    x, y = (np.round(point, 2) + 0.0).tolist()
    return f"({x:.12g}, {y:.12g})"


def counted(kinds: Counter[str]) -> str:
    """The number of shapes of each kind, as text for people."""
    return ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))


REPEAT_S = 0.1  # time between two signals after the time limit


@contextmanager
def time_limit(seconds: float = SECONDS) -> Iterator[None]:
    """Limits the time of the body of a `with` statement.

    Outside the main thread, which alone receives signals, there is no limit.

    Raises:
        InputError: the time is over.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(_signum: int, _frame: FrameType | None) -> NoReturn:
        raise too_much(f"takes longer than {seconds:g} s to read")

    usual = signal.signal(signal.SIGALRM, stop)
    # The signal repeats, since Python drops an exception that is raised within a finalizer or a
    # callback of the garbage collector.
    signal.setitimer(signal.ITIMER_REAL, seconds, REPEAT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, usual)
