"""How the jaws get from one opening to another: settings in counts, and the strokes of a closing motion.

Jaws close at full speed to just before the first contact that the belief allows, then at the squeeze's speed.
A regulated squeeze (the paper's experiment 8*) closes with the least force until contact, and raises it only
where that can change anything.
"""

from typing import NamedTuple

from runtime.execution.reading import CLOSED_COUNTS
from runtime.execution.tips import TipArc
from runtime.table import Calibration, Node, Profile, Squeeze, Timing

GENTLE_SPEED, GENTLE_FORCE = 0, 0  # counts: the gripper's least, of a 2F-85 20 mm/s and about 20 N
RAISE_COUNTS = (
    64  # largest step of the force, a quarter of its range, between two looks at the reading
)


class Stroke(NamedTuple):
    """One motion of the jaws."""

    request_counts: int  # where to, 255 for as far as they go
    speed_counts: int  # rSP
    force_counts: int  # rFR
    advance_mm: float  # height of the arm above the tips' height that the whole stroke needs


def opening_counts(opening_um: int, calibration: Calibration) -> int:
    """The position to request so that the jaws are at least `opening_um` apart, or as far as they go."""
    wide = [count for count, width in enumerate(calibration.widths_um) if width >= opening_um]
    full = opening_um >= calibration.widths_um[0]
    return wide[-1] if wide and not full else 0


def is_regulated(squeeze: Squeeze, profile: Profile, *, wanted: bool) -> bool:
    """Whether a squeeze closes gently first: off where its force is the least one already."""
    return wanted and profile.force_counts(squeeze.force_mn) > GENTLE_FORCE


def closing(
    node: Node,
    profile: Profile,
    calibration: Calibration,
    arc: TipArc | None,
    open_mm: float,
    timing: Timing,
    *,
    regulated: bool,
) -> list[Stroke]:
    """The strokes, at least one, that close jaws standing `open_mm` apart; the last goes as far as they can.

    A `regulated` one's force is the least until contact; `raising` tells the rest.
    """
    squeeze = node.squeeze
    force = GENTLE_FORCE if regulated else profile.force_counts(squeeze.force_mn)
    slow = profile.speed_counts(squeeze.speed_um_s)
    fast = max(slow, profile.speed_counts(round(1000 * timing.fastest_mm_s)))
    contact_mm = None if node.contact_um is None else node.contact_um / 1000
    near_mm = timing.approach_mm(open_mm, contact_mm, squeeze.speed_um_s / 1000)
    ends = [0.0] if arc is None else arc.stages(open_mm, 0.0)
    if near_mm < open_mm:
        ends = sorted({*ends, near_mm}, reverse=True)
    strokes: list[Stroke] = []
    start_mm, start_counts = open_mm, calibration.count(round(1000 * open_mm))
    for end_mm in ends:
        request = calibration.count(round(1000 * end_mm)) if end_mm > 0.0 else CLOSED_COUNTS
        if request == start_counts:  # two ends within one count
            continue
        speed = fast if near_mm <= end_mm < open_mm else slow
        advance_mm = 0.0 if arc is None else arc.most_mm(end_mm, start_mm)
        strokes.append(Stroke(request, speed, force, advance_mm))
        start_mm, start_counts = end_mm, request
    return strokes


def raising(squeeze: Squeeze, profile: Profile) -> list[int]:
    """The force settings a regulated squeeze goes through after contact, the node's own last."""
    last = profile.force_counts(squeeze.force_mn)
    return [*range(GENTLE_FORCE + RAISE_COUNTS, last, RAISE_COUNTS), last]
