"""The grid of the file, format 2: each value of a table as a small integer, and back.

`..._number(value(number)) == number` wherever a number is written, so that a table on the grid comes back as
it was; where several numbers would mean one value, the one that `..._number` gives is written.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from functools import lru_cache
from math import isqrt
from typing import Self

from runtime.errors import TableError
from runtime.table_model import ANGLES_PER_TURN, MAX_COVARIANCE, PPM, GripperSpec

TURN_NRAD = 6_283_185_307
SPREAD_BITS = 2  # of a variance after its leading one: steps of a fifth, as 50 trials would leave in doubt
EIGHTHS = 8  # of a correlation
FINEST_TRIALS = 10_000
QUARTERS = 4  # of a count, for expected widths
FINEST_COUNT_UM = 16


@dataclass(frozen=True, slots=True)
class WidthGrid:
    """The widths of a gripper: an interval ends midway between two counts, where no count's width lies.

    Attributes:
        opening_um: width at `count_open`.
        counts: from there to the width 0.
        counts_um: the width of each count on the default line; rising.
        ends_um: the closed end, each width midway between two counts, the open end; rising.
    """

    opening_um: int
    counts: int
    counts_um: list[int]
    ends_um: list[int]

    @classmethod
    def of(cls, gripper: GripperSpec) -> Self:
        """The grid of a gripper's default line.

        Raises:
            TableError: its counts are finer than a table can tell.
        """
        opening, counts = gripper.opening_um, gripper.count_closed - gripper.count_open
        if opening < FINEST_COUNT_UM * counts:
            raise TableError(f"{counts} counts of the gripper lie on {opening} um; a table cannot tell them")
        halves = [(opening * half + counts) // (2 * counts) for half in range(2 * counts + 1)]
        return cls(opening, counts, halves[::2], [0, *halves[1::2], opening])

    def low_number(self, width_um: int) -> int:
        """The end below the first count that is not below a width."""
        return bisect_left(self.counts_um, width_um)

    def high_number(self, width_um: int) -> int:
        """The end above the last count that is not above a width."""
        return bisect_right(self.counts_um, width_um)

    def end_number(self, width_um: int) -> int:
        """The number of an end.

        Raises:
            TableError: it is none.
        """
        number = bisect_left(self.ends_um, width_um)
        if number == len(self.ends_um) or self.ends_um[number] != width_um:
            raise TableError(f"an interval ends at {width_um} um, which is not on the file's grid")
        return number

    def expected_number(self, width_um: int) -> int:
        """A width in quarters of a count from the closed end, the nearest."""
        return (2 * QUARTERS * self.counts * width_um + self.opening_um) // (2 * self.opening_um)

    def expected_um(self, number: int) -> int:
        """So many quarters of a count, um."""
        return (2 * self.opening_um * number + QUARTERS * self.counts) // (2 * QUARTERS * self.counts)

    def expected_within(self, offsets: list[int], lows: list[int], highs: list[int]) -> list[int]:
        """Many expected widths, each so many quarters above the middle between two ends, um."""
        counts = QUARTERS * self.counts
        # End n lies n - 1/2 counts from the closed end, so the middle is an even number of quarters.
        return [
            (2 * self.opening_um * (offset + 2 * (low + high - 1)) + counts) // (2 * counts)
            for offset, low, high in zip(offsets, lows, highs, strict=True)
        ]


def near(value: int, grid: int) -> int:
    """The multiple of the grid nearest to a value, the greater one of two."""
    return (value + grid // 2) // grid * grid


@lru_cache(maxsize=ANGLES_PER_TURN)
def angle_number(angle_urad: int) -> int:
    """An angle in parts of a turn, the nearest."""
    return (2_000 * ANGLES_PER_TURN * angle_urad + TURN_NRAD) // (2 * TURN_NRAD)


@lru_cache(maxsize=ANGLES_PER_TURN)
def angle_urad(number: int) -> int:
    """So many parts of a turn, urad."""
    return (number * TURN_NRAD + 500 * ANGLES_PER_TURN) // (1_000 * ANGLES_PER_TURN)


def spread_number(value: int) -> int:
    """The number of a variance >= 0: itself up to 7, then four to the octave, the nearest."""
    shift = max(value.bit_length() - 1 - SPREAD_BITS, 0)
    mantissa = (value + (1 << shift >> 1)) >> shift  # a carry leads to the next octave's first number
    return (shift << SPREAD_BITS) + mantissa


def spread_number_below(value: int) -> int:
    """As `spread_number`, but never of a greater value."""
    shift = max(value.bit_length() - 1 - SPREAD_BITS, 0)
    return (shift << SPREAD_BITS) + (value >> shift)


def spread(number: int) -> int:
    """The value of a number >= 0."""
    shift = max((number >> SPREAD_BITS) - 1, 0)
    return number - (shift << SPREAD_BITS) << shift


MAX_SPREAD_NUMBER = spread_number(MAX_COVARIANCE)
SPREADS = tuple(map(spread, range(MAX_SPREAD_NUMBER + 1)))


def correlation_number(covariance: int, one: int, other: int) -> int:
    """A covariance as eighths of the greatest that its two variances allow, -8..8, the nearest."""
    most = isqrt(one * other)
    if covariance == 0 or most == 0:
        return 0
    eighths = (2 * EIGHTHS * abs(covariance) + most) // (2 * most)
    return min(eighths, EIGHTHS) if covariance > 0 else -min(eighths, EIGHTHS)


def covariance(number: int, one: int, other: int) -> int:
    """So many eighths of the greatest covariance of two variances, towards zero from half."""
    if number == 0:
        return 0
    most = (2 * abs(number) * isqrt(one * other) + EIGHTHS - 1) // (2 * EIGHTHS)
    return most if number > 0 else -most


def failures(success_ppm: int, trials: int) -> int:
    """How many trials failed: whole ones, or shares of 1 / 10 000 where there are none or more than that."""
    units = trials if 0 < trials <= FINEST_TRIALS else FINEST_TRIALS
    return (2 * (PPM - success_ppm) * units + PPM) // (2 * PPM)


def success_ppm(failures: int, trials: int) -> int:
    """The share of trials that did not fail, ppm."""
    units = trials if 0 < trials <= FINEST_TRIALS else FINEST_TRIALS
    return PPM - (2 * failures * PPM + units) // (2 * units)
