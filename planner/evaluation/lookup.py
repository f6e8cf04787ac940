"""The segments of many decision maps as arrays, looked up for many parts at once."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from planner.arrays import IntArray
from runtime.table import Segments

SPAN = 1 << 21  # more um than a gripper opens


class Lookup(NamedTuple):
    """The segments of rows of step functions, one after the other."""

    start: IntArray  # (s,) rising: the first width of each [um], and `SPAN` for each row before its own
    branch: IntArray  # (s,) what a width from there on means: a branch, or `REJECT`

    @classmethod
    def of(cls, rows: Sequence[Segments]) -> Self:
        """Of some step functions."""
        starts = [SPAN * row + np.array(each.starts_um) for row, each in enumerate(rows)]
        return cls(np.concatenate(starts), np.concatenate([each.branches for each in rows]))

    def segment(self, row: IntArray, width_um: IntArray) -> IntArray:
        """The segments (n,) that widths (n,), none below 0, fall into in rows (n,)."""
        return np.searchsorted(self.start, SPAN * row + width_um, side="right") - 1
