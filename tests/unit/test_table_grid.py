"""The grid of the file: numbers come back, values move by less than a step, nothing has two numbers."""

from math import isqrt, pi
from random import Random

import pytest
from runtime.table_grid import (
    EIGHTHS,
    MAX_SPREAD_NUMBER,
    WidthGrid,
    angle_number,
    angle_urad,
    correlation_number,
    covariance,
    failures,
    near,
    spread,
    spread_number,
    spread_number_below,
    success_ppm,
)
from sample_tables import GRIPPER

from runtime.table import GripperSpec, TableError

GRID = WidthGrid.of(GRIPPER)


def test_angles_are_quarter_degrees() -> None:
    for number in range(-720, 721):
        assert angle_number(angle_urad(number)) == number
        assert angle_urad(number) == pytest.approx(1e6 * pi * number / 720, abs=1)
    for value in range(-3_142_000, 3_142_000, 977):
        assert abs(angle_urad(angle_number(value)) - value) <= 2_183


def test_spreads_have_four_steps_to_the_octave() -> None:
    values = [spread(number) for number in range(MAX_SPREAD_NUMBER + 1)]
    assert values[:12] == [0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14]
    assert values == sorted(set(values))
    for number, value in enumerate(values):
        assert spread_number(value) == spread_number_below(value) == number
    for value in range(5_000):
        assert abs(spread(spread_number(value)) - value) <= value / 8
        assert value - value / 5 <= spread(spread_number_below(value)) <= value


def test_covariances_come_back_and_respect_their_variances() -> None:
    variances = [spread(number) for number in range(50)]
    for one in variances:
        for other in variances[::3]:
            for eighths in range(-EIGHTHS, EIGHTHS + 1):
                value = covariance(eighths, one, other)
                assert value**2 <= one * other
                number = correlation_number(value, one, other)
                assert covariance(number, one, other) == value
    assert correlation_number(10**6, 4, 9) == EIGHTHS
    assert correlation_number(-5, 100, 100) == 0  # half an eighth goes to the side of none
    assert correlation_number(-20, 100, 100) == -2
    assert isqrt(100 * 100) == 100


def test_failures_are_whole_trials() -> None:
    random = Random(1)
    for trials in (0, 1, 7, 9_999, 10_000, 10_001, *(random.randrange(10**10) for _ in range(500))):
        share = random.randrange(10**6 + 1)
        failed = failures(share, trials)
        again = success_ppm(failed, trials)
        assert failures(again, trials) == failed
        assert abs(again - share) <= max(1, 500_000 // min(trials or 10_000, 10_000) + 1)
    assert failures(997_100, 3_476) == 10


def test_interval_ends_lie_midway_between_counts() -> None:
    assert GRID.ends_um[0] == 0
    assert GRID.ends_um[-1] == 85_000
    assert GRID.ends_um == sorted(set(GRID.ends_um))
    for low, high, end in zip(GRID.counts_um, GRID.counts_um[1:], GRID.ends_um[1:], strict=False):
        assert abs((low + high) / 2 - end) <= 1
    for number, end in enumerate(GRID.ends_um):
        assert GRID.end_number(end) == number
    with pytest.raises(TableError, match="ends at 20000 um, which is not on the file's grid"):
        GRID.end_number(20_000)


def test_numbers_of_interval_ends_keep_the_counts_inside() -> None:
    random = Random(2)
    for _ in range(2_000):
        low = random.randrange(85_000)
        high = random.randrange(low, 85_001)
        inside = [width for width in GRID.counts_um if low <= width <= high]
        ends = GRID.ends_um[GRID.low_number(low)], GRID.ends_um[GRID.high_number(high)]
        assert [width for width in GRID.counts_um if ends[0] <= width <= ends[1]] == inside


def test_expected_widths_are_quarters_of_a_count() -> None:
    for number in range(4 * 227 + 1):
        assert GRID.expected_number(GRID.expected_um(number)) == number
    assert GRID.expected_um(4 * 227) == 85_000


def test_nearest_multiple_goes_up_from_half() -> None:
    assert [near(value, 100) for value in (-50, -51, 49, 50, 149)] == [0, -100, 0, 100, 100]


def test_counts_finer_than_the_grid_are_refused() -> None:
    with pytest.raises(TableError, match="227 counts of the gripper lie on 3000 um"):
        WidthGrid.of(GripperSpec("tiny", 3_000, 1, 1, 3, 230, 0))
