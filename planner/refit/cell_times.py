"""Estimates the arm's acceleration and the response times of arm and jaws from the journals of a cell."""

import math
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from runtime.table import CLEAR_MM, Phases, Schedule, Table, Timing, job_of, trapezoid_s

LEAST_SQUEEZES = 20  # fewer squeezes give no estimate
LEAST, MOST = 10.0, 100_000.0  # range of accelerations tried [mm/s2]
HALVINGS = 60  # number of halvings of the range of accelerations


class Timed(NamedTuple):
    """A squeeze of a journal: its node, the measured width, and the measured times of its phases."""

    node: int  # index of the table's node
    width_mm: float
    last: bool  # whether it is the last squeeze of the part
    phases: Phases


def learned(table: Table, squeezes: Sequence[Timed]) -> dict[str, float]:
    """Estimates the response times of arm and jaws, the polling time and the arm's acceleration.

    After the last squeeze of a part the hand rises to the retreat height; after other squeezes it rises to
    just above the part. The difference between the times of the two rises gives the acceleration. The arm's
    response time is the measured time of the shorter rise less the time of motion at this acceleration.

    Returns:
        The values by key of a job's section [cell], without the keys for which the squeezes have no data.
    """
    timing, result = Schedule.of(table, job_of(table)).timing, dict[str, float]()
    if len(squeezes) < LEAST_SQUEEZES:
        return result
    plain = [squeeze for squeeze in squeezes if not table.nodes[squeeze.node].pushes]
    if plain:
        answers = [_jaws(table, timing, squeeze) for squeeze in plain]
        result["jaw_answer_s"] = round(max(median(answers), 0.0), 4)
        looks = [
            squeeze.phases.release_s - CLEAR_MM / _speed(table, squeeze)
            for squeeze in plain
            if table.nodes[squeeze.node].release is None  # the hand opens where it squeezed
        ]
        if looks:
            result["poll_s"] = round(max(median(looks), 0.0) / 3.0, 4)
    low, high = timing.regrasp_mm - timing.squeeze_mm, timing.retreat_mm - timing.squeeze_mm
    short = [squeeze.phases.rise_s for squeeze in plain if not squeeze.last]
    look_s = result.get("poll_s", timing.poll_s)
    long = [
        squeeze.phases.rise_s - look_s
        for squeeze in plain
        if squeeze.last and squeeze.phases.rise_s > _opened_s(table, timing, squeeze) + 2.0 * look_s
    ]
    if low < high and short and long:
        acceleration = _acceleration(median(long) - median(short), low, high, timing.arm_speed_mm_s)
        result["arm_acceleration_mm_s2"] = round(acceleration, 1)
        answer_s = median(short) - trapezoid_s(low, timing.arm_speed_mm_s, acceleration)
        result["arm_answer_s"] = round(max(answer_s, 0.0), 4)
    return result


def _opened_s(table: Table, timing: Timing, squeeze: Timed) -> float:
    """Seconds that the jaws take to open for the next part, while the hand rises."""
    next_mm = table.nodes[0].squeeze.opening_um / 1e3
    return timing.opening_s(squeeze.width_mm, next_mm, _speed(table, squeeze))


def _acceleration(gap_s: float, low_mm: float, high_mm: float, speed_mm_s: float) -> float:
    """The acceleration [mm/s2] at which an arm takes `gap_s` longer for `high_mm` than for `low_mm`."""
    least, most = LEAST, MOST
    for _ in range(HALVINGS):
        middle = math.sqrt(least * most)
        gap = trapezoid_s(high_mm, speed_mm_s, middle) - trapezoid_s(low_mm, speed_mm_s, middle)
        least, most = (middle, most) if gap > gap_s else (least, middle)
    return math.sqrt(least * most)


def _jaws(table: Table, timing: Timing, squeeze: Timed) -> float:
    """Response time of the jaws in one squeeze [s]: measured time of closing less the time of the strokes."""
    node, speed = table.nodes[squeeze.node], _speed(table, squeeze)
    contact = None if node.contact_um is None else node.contact_um / 1e3
    stated_s = timing.close_s(node.squeeze.opening_um / 1e3, contact, squeeze.width_mm, speed)
    return squeeze.phases.close_s - stated_s + timing.jaw_answer_s


def _speed(table: Table, squeeze: Timed) -> float:
    return table.nodes[squeeze.node].squeeze.speed_um_s / 1e3
