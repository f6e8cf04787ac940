"""Timing values of a cell, learned from the seconds of its squeezes."""

from dataclasses import replace

import pytest
from sample_tables import changed, small_table, with_job

from planner.refit.cell_times import Timed, learned
from runtime.table import Schedule, Squeezed, job_of

CELL = {"arm_acceleration_mm_s2": 750.0, "arm_answer_s": 0.021, "jaw_answer_s": 0.11}
CELL["poll_s"] = 0.025


def test_learned_recovers_the_timing_of_the_cell() -> None:
    root = small_table().nodes[0]
    narrow = root._replace(squeeze=root.squeeze._replace(opening_um=40_000))
    table = with_job(changed(small_table(), {"nodes.0": narrow}), '{"part":{"height_mm":16.0}}')
    schedule = Schedule.of(table, job_of(table))
    cell = replace(schedule, timing=replace(schedule.timing, **CELL))
    squeezes = [
        Timed(built.node, built.width_mm, number == 1, phases)
        for width in range(20, 31)
        for built, number, phases in _part(cell, width)
    ]
    result = learned(table, squeezes)
    for key, value in CELL.items():
        assert result[key] == pytest.approx(value, rel=1e-3, abs=1e-4)


def _part(cell: Schedule, width: float) -> list[tuple]:
    result = [Squeezed(0, 30.0, 1), Squeezed(1, float(width), 0)]
    return list(zip(result, range(2), cell.part(result), strict=True))


def test_learned_without_squeezes_is_empty() -> None:
    assert learned(small_table(), []) == {}
