"""How the jaws get from one opening to another: settings in counts, and the strokes of a closing motion.

A regulated squeeze (the paper's experiment 8*) runs at the node's speed and the least force to just wider
than the widest planned outcome, then as slowly as it can until contact, and only then raises the force.
"""

from typing import NamedTuple

from runtime.execution.reading import CLOSED_COUNTS
from runtime.execution.tips import TipArc
from runtime.table import Calibration, Node, Squeeze

# Speed is the rate of the opening, force the nominal grip force, linear over 0..255 (Robotiq SDK, units.cpp).
SLOWEST_UM_S, FASTEST_UM_S = 20_000, 150_000
WEAKEST_MN, STRONGEST_MN = 20_000, 235_000
GENTLE_SPEED, GENTLE_FORCE = 0, 0  # counts: 20 mm/s, about 20 N
NEAR_UM = 3_000  # how much wider than the widest outcome the gentle part begins
RAISE_COUNTS = 64  # the force rises by at most so much (about 54 N) before the reading is looked at again


class Stroke(NamedTuple):
    """One motion of the jaws."""

    request_counts: int  # where to, 255 for as far as they go
    speed_counts: int  # rSP
    force_counts: int  # rFR
    advance_mm: float  # height of the arm above the tips' height that the whole stroke needs


def speed_counts(speed_um_s: int) -> int:
    """The fastest speed setting that is not faster than asked, 0..255."""
    return _scale(speed_um_s, SLOWEST_UM_S, FASTEST_UM_S)


def force_counts(force_mn: int) -> int:
    """The strongest force setting that is not stronger than asked, 0..255."""
    return _scale(force_mn, WEAKEST_MN, STRONGEST_MN)


def opening_counts(opening_um: int, calibration: Calibration) -> int:
    """The position to request so that the jaws are at least `opening_um` apart, or as far as they go."""
    wide = [count for count, width in enumerate(calibration.widths_um) if width >= opening_um]
    full = opening_um >= calibration.widths_um[0]
    return wide[-1] if wide and not full else 0


def is_regulated(squeeze: Squeeze, *, wanted: bool) -> bool:
    """Whether a squeeze closes gently first: off where its force is the least one already."""
    return wanted and force_counts(squeeze.force_mn) > GENTLE_FORCE


def closing(
    node: Node, calibration: Calibration, arc: TipArc | None, open_mm: float, *, regulated: bool
) -> list[Stroke]:
    """The strokes, at least one, that close jaws standing `open_mm` apart; the last goes as far as they can.

    A `regulated` one's force is the least until contact; `raising` tells the rest.
    """
    squeeze = node.squeeze
    force = GENTLE_FORCE if regulated else force_counts(squeeze.force_mn)
    ends = [0.0] if arc is None else arc.stages(open_mm, 0.0)
    near_counts = 0
    near_mm = (max(branch.high_um for branch in node.branches) + NEAR_UM) / 1000
    if regulated and near_mm < open_mm:
        ends = sorted({*ends, near_mm}, reverse=True)
        near_counts = calibration.count(round(1000 * near_mm))
    strokes: list[Stroke] = []
    start_mm, start_counts = open_mm, calibration.count(round(1000 * open_mm))
    for end_mm in ends:
        request = calibration.count(round(1000 * end_mm)) if end_mm > 0.0 else CLOSED_COUNTS
        if request == start_counts:  # two ends within one count
            continue
        gentle = regulated and start_counts >= near_counts
        speed = GENTLE_SPEED if gentle else speed_counts(squeeze.speed_um_s)
        advance_mm = 0.0 if arc is None else arc.most_mm(end_mm, start_mm)
        strokes.append(Stroke(request, speed, force, advance_mm))
        start_mm, start_counts = end_mm, request
    return strokes


def raising(squeeze: Squeeze) -> list[int]:
    """The force settings a regulated squeeze goes through after contact, the node's own last."""
    last = force_counts(squeeze.force_mn)
    return [*range(GENTLE_FORCE + RAISE_COUNTS, last, RAISE_COUNTS), last]


def _scale(value: int, least: int, most: int) -> int:
    return min(max((value - least) * 255 // (most - least), 0), 255)
